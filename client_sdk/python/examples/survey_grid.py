"""A drone flies to and fro over a rectangle, stops at each point of a grid, and writes its places.

python survey_grid.py DRONE X0,Y0,X1,Y1 STEP HEIGHT positions.csv
"""

import csv
import sys

import numpy as np

from volery import Client

drone = int(sys.argv[1])
x0, y0, x1, y1 = (float(word) for word in sys.argv[2].split(","))
step, height = float(sys.argv[3]), float(sys.argv[4])

columns = np.arange(y0, y1 + step / 2, step)
grid = []
for row, x in enumerate(np.arange(x0, x1 + step / 2, step)):
    grid += [(x, y, height) for y in (columns if row % 2 == 0 else columns[::-1])]

with Client() as client, client.lease([drone]) as group, open(sys.argv[5], "w") as file:
    table = csv.writer(file)
    table.writerow(["x", "y", "z", "yaw"])
    for number, goal in enumerate(grid, 1):
        group.fly({drone: goal})
        (state,) = group.states()
        assert state.estimate is not None
        table.writerow([f"{v:.3f}" for v in (*state.estimate.position, state.estimate.yaw)])
        print(f"{number} of {len(grid)} at {goal}", flush=True)
    group.land()
