"""Three drones fly to the corners of a triangle, change places, and land.

python group_flight.py 1 2 3
"""

import sys

from volery import Client

drones = [int(word) for word in sys.argv[1:4]]
corners = [(-1.5, -1.7, 1.0), (1.5, 0.0, 1.0), (-1.5, 1.7, 1.0)]

with Client() as client, client.lease(drones) as group:
    group.fly(dict(zip(drones, corners)))
    print("at the corners", flush=True)
    flight = group.plan(dict(zip(drones, corners[1:] + corners[:1])))
    print(f"{flight.info.duration_s:.0f} s, never nearer than {flight.info.closest_m:.2f} m")
    flight.start().wait()
    print("changed places", flush=True)
    group.land()
