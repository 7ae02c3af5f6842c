"""Every example runs, with the real server and simulated drones."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.room import Room, Scan, camera, pose
from support.script import PACKAGE, Script
from support.server import Field, Server, until

from volery import Client, Map
from volery.photos import png

EXAMPLES = PACKAGE / "examples"


def test_scan_and_map(server: Server, photos: Scan, room: Room, tmp_path: Path) -> None:
    names = list(photos.truth)
    places = [np.array(photos.truth[name].position) for name in (names[0], names[8])]
    truth = pose((0.2, 0.1, 0.0), 1.0)
    (tmp_path / "new.png").write_bytes(png(room.photo(truth)))
    known = f"{names[0]},{names[8]},{np.linalg.norm(places[0] - places[1])}"
    said = Script(
        server,
        tmp_path / "log",
        EXAMPLES / "scan_and_map.py",
        str(photos.folder),
        known,
        str(tmp_path / "new.png"),
    ).finish()
    assert ", metric>" in said and "map_from_camera" in said
    last_row = said.strip().splitlines()[-1]
    assert [float(word) for word in last_row.strip(" []").split()] == [0, 0, 0, 1]


def test_follow_pose(server: Server, hall: Map, room: Room, field: Field, tmp_path: Path) -> None:
    with hall.stream(camera(), track=True, drone=field.ids[0]) as stream:
        script = Script(
            server, tmp_path / "log", EXAMPLES / "follow_pose.py", str(field.ids[0]), "5"
        )
        step = 0
        while script.process.poll() is None and step < 200:
            step += 1
            stream.send(room.photo(pose((0.5, 0.2, 0.1), 0.4)), t_capture_ns=step * 100_000_000)
            stream.receive()
    said = script.finish().splitlines()
    assert len(said) == 5
    assert said[-1].startswith("tracking ")
    place = [float(word) for word in said[-1].split()[1:4]]
    assert np.linalg.norm(np.subtract(place, (0.5, 0.2, 0.1))) < 0.05


def test_group_flight(
    server: Server, client: Client, hall: Map, field: Field, tmp_path: Path
) -> None:
    script = Script(server, tmp_path / "log", EXAMPLES / "group_flight.py", *map(str, field.ids))
    script.until_said("at the corners")
    corners = [(-1.5, -1.7, 1.0), (1.5, 0.0, 1.0), (-1.5, 1.7, 1.0)]
    for drone, corner in zip(field.ids, corners):
        assert np.linalg.norm(np.subtract(field.place(drone), corner)) < 0.4, drone
    nearest = [
        np.linalg.norm(np.subtract(field.place(a), field.place(b)))
        for a, b in field.watch(script.process)
    ]
    assert min(nearest) > 0.8
    assert "changed places" in script.finish()
    assert not any(field.truth[drone]["armed"] for drone in field.ids)


def test_a_killed_script_holds_its_drones(
    server: Server, client: Client, hall: Map, field: Field, tmp_path: Path
) -> None:
    script = Script(server, tmp_path / "log", EXAMPLES / "group_flight.py", *map(str, field.ids))
    script.until_said("s, never nearer")
    until(lambda: sum(field.speed(drone) > 0.4 for drone in field.ids) >= 2, "they fly")
    script.process.send_signal(signal.SIGKILL)
    killed, killed_ns = field.clock(), time.time_ns()
    script.process.wait()
    until(lambda: max(field.speed(drone) for drone in field.ids) < 0.15, "they hold")
    # The lease runs out within a second, and they brake from 1 m/s.
    assert max(field.truth[drone]["t"] for drone in field.ids) - killed < 2.0
    for drone in field.ids:
        held = [e.t_ns for e in client.api.drone_events(drone).items if e.value == "lease_over"]
        assert 0 < held[-1] - killed_ns < 1e9


def test_survey_grid(
    server: Server, client: Client, hall: Map, field: Field, tmp_path: Path
) -> None:
    drone = field.ids[1]
    x, y, _ = field.place(drone)
    area = f"{x},{y},{x + 0.5},{y + 0.5}"
    table = tmp_path / "positions.csv"
    Script(
        server,
        tmp_path / "log",
        EXAMPLES / "survey_grid.py",
        str(drone),
        area,
        "0.5",
        "0.8",
        str(table),
    ).finish()
    rows = np.genfromtxt(table, delimiter=",", skip_header=1)
    wanted = [(x, y, 0.8), (x, y + 0.5, 0.8), (x + 0.5, y + 0.5, 0.8), (x + 0.5, y, 0.8)]
    assert np.linalg.norm(rows[:, :3] - wanted, axis=1).max() < 0.3
    assert not field.truth[drone]["armed"]


def test_a_group_flies_in_twenty_lines() -> None:
    source = (EXAMPLES / "group_flight.py").read_text()
    code = source.split('"""')[2].splitlines()
    assert len([line for line in code if line.strip() and not line.startswith("#")]) <= 20


@pytest.mark.parametrize("example", sorted(path.name for path in EXAMPLES.glob("*.py")))
def test_examples_are_tried(example: str) -> None:
    assert f'"{example}"' in Path(__file__).read_text(), example


def test_a_wheel_is_built(tmp_path: Path) -> None:
    pytest.importorskip("build")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", str(tmp_path)]
    done = subprocess.run([*command, str(PACKAGE)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = tmp_path.glob("volery-*-py3-none-any.whl")
    check = "import volery, os; print(volery.__file__); volery.Client('http://127.0.0.1:1')"
    environment = dict(os.environ, PYTHONPATH=str(wheel))
    found = subprocess.run(
        [sys.executable, "-c", check], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    assert found.stdout.startswith(str(wheel)), found.stderr
    import zipfile

    assert "volery/py.typed" in zipfile.ZipFile(wheel).namelist()
