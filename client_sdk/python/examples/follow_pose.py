"""Prints where a drone's camera is, frame by frame.

python follow_pose.py DRONE [FRAMES]
"""

import asyncio
import itertools
import sys

from volery import AsyncClient


async def main(drone_id: int, frames: int) -> None:
    counter = itertools.count(1)
    async with AsyncClient() as client:
        drone = await client.drone(drone_id)
        async for message in drone.poses():
            tracked = message.result
            if tracked.pose is None:
                print(f"{tracked.state}: {tracked.reason}", flush=True)
            else:
                x, y, z = tracked.pose.position
                print(f"{tracked.state} {x:.3f} {y:.3f} {z:.3f} m, {tracked.age_ms:.0f} ms old")
            if next(counter) == frames:
                return


asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0))
