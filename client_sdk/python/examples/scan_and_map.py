"""Photos become a metric map, and a photo finds its pose in it.

python scan_and_map.py PHOTOS/ PHOTO_A,PHOTO_B,METERS NEW_PHOTO
"""

import sys

from volery import Client, KnownDistance

folder, known, photo = sys.argv[1:4]
image_a, image_b, meters = known.split(",")
with Client() as client:
    job = client.reconstruct(
        folder, scale=KnownDistance(image_a, image_b, float(meters)), preset="fast"
    )
    map = job.wait(progress=True)
    print(map)
    answer = map.localize(photo)
    if answer.pose is None:
        sys.exit(f"{photo} has no place: {answer.reason}")
    print("map_from_camera of", photo)
    print(answer.pose.matrix.round(3))
