"""Every shell command of the documents runs, but for those that `NOT_RUN` names with the reason."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Tuple

import numpy as np
import pytest
from support.documents import commands
from support.room import Scan, camera
from support.server import PATIENCE, PROGRAM, Server, until

from volery import Client

NOT_RUN = {
    "./run demo": "takes minutes; cli/tests try the same without a page",
    "./run test": "runs this",
    "./run bench": "takes an hour",
    "./run bench load 60": "takes minutes of both cores",
    "cargo build --release": "made the program that is tried here",
    "pip install client_sdk/python": "asks a package registry; test_examples builds the same wheel",
    "volery maps register": "a name: README.md has the whole command",
    "volery maps extend": "a name: README.md has the whole command",
    "volery doctor --mavlink": "a name: README.md has the whole command",
    "volery doctor --mavlink udp:HOST:PORT": "wants drones that no server hears",
    "volery replay flight.tlog": "wants a recorded flight; cli/src/replay.rs has its own tests",
    "volery demo --headless --json": "takes minutes; cli/tests try it",
    "volery compare-positioning": "takes a minute of computing; cli/src/compare has its own tests",
}


@dataclass(frozen=True)
class Run:
    """How a command is tried."""

    #: What it says.
    says: str
    #: What is written otherwise: upper case stands for what only the test knows.
    change: Tuple[Tuple[str, str], ...] = ()
    #: Whether it ends by itself.
    ends: bool = True


#: A mesh is made once; it is what `fast` leaves out.
FAST = (" -o map/", " -o other/ --preset fast")
FAST_JOB = (" --wait", " --wait --preset fast")

#: Ends of commands that did what they say; 3: the map holds, but is not whole.
DONE = (0, 3)

RUN: Dict[str, Run] = {
    "volery reconstruct PHOTOS/ -o map/": Run("map: map/"),
    "volery localize map/ NEW_PHOTOS/ -o poses.csv": Run("1 of 1 photos localized"),
    "volery reconstruct PHOTOS/ -o map/ --known-distance a.jpg,b.jpg,3.0": Run("map: ", (FAST,)),
    "volery reconstruct PHOTOS/ -o map/ --telemetry telemetry.csv": Run("map: ", (FAST,)),
    "volery reconstruct PHOTOS/ -o map/ --positions positions.csv": Run("map: ", (FAST,)),
    "volery reconstruct PHOTOS/ -o map/ --model sparse/0": Run("map: ", (FAST,)),
    "volery reconstruct PHOTOS/ -o map/ --model transforms.json --model-is-metric": Run(
        "map: ", (FAST,)
    ),
    "volery serve --data data/ --listen 127.0.0.1:8080": Run(
        "admin token", ((":8080", ":0"),), ends=False
    ),
    "volery doctor": Run("vector unit"),
    "volery maps register MAP_A MAP_B --wait": Run(", map ", (FAST_JOB,)),
    "volery maps extend MAP IMAGESET --wait": Run(", map ", (FAST_JOB,)),
    "volery serve --data data/ --mavlink udp:127.0.0.1:14550 --mavlink-key KEYFILE": Run(
        "heard on udp:", ((":14550", ":0"), ("serve", "serve --listen 127.0.0.1:0")), ends=False
    ),
    "export VOLERY_SERVER=http://127.0.0.1:8420 VOLERY_TOKEN=...": Run(
        "first half", (("http://127.0.0.1:8420", "SERVER"), ("...", "TOKEN && volery maps"))
    ),
    "volery simulate --drones 3 --flavor mixed --mavlink 127.0.0.1:14550": Run(
        '"system_id":3', (("127.0.0.1:14550", "MAVLINK"),), ends=False
    ),
    "volery simulate --glb map.glb --mjpeg 127.0.0.1:8081 --fault 2:freeze@20-25": Run(
        '"camera_url"', ((":8081", ":0"),), ends=False
    ),
    "volery options": Run("max_features"),
    "volery upload photos.zip": Run("10 stored"),
    "volery localize map/ PHOTO --near 1.2,0.5,1.4 --telemetry telemetry.csv": Run(
        "of 1 photos localized"
    ),
    "volery simulate --help": Run("--fault"),
}


@pytest.fixture(scope="module")
def folder(photos: Scan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands take for granted."""
    folder = tmp_path_factory.mktemp("user")
    for name in ("PHOTOS", "NEW_PHOTOS", "bin"):
        (folder / name).mkdir()
    (folder / "bin" / "volery").symlink_to(PROGRAM)
    named = {0: "a.jpg", 4: "b.jpg"}
    telemetry = ["image,yaw_deg,pitch_deg,roll_deg,height_m"]
    positions = ["image,x,y,z"]
    for index, file in enumerate(photos.files()[:10]):
        name = named.get(index, file.name)
        shutil.copy(file, folder / "PHOTOS" / name)
        pose = photos.truth[file.name]
        x, y, z = pose.position
        ahead = pose.rotation[:, 2]
        yaw = np.degrees(np.arctan2(ahead[0], ahead[1]))
        telemetry.append(f"{name},{yaw},{np.degrees(np.arcsin(ahead[2]))},0,{z}")
        positions.append(f"{name},{x},{y},{z}")
    shutil.copy(photos.files()[3], folder / "NEW_PHOTOS" / "new.png")
    shutil.copy(photos.files()[3], folder / "PHOTO")
    (folder / "telemetry.csv").write_text(
        "\n".join([*telemetry, telemetry[-1].replace(name, "PHOTO")])
    )
    (folder / "positions.csv").write_text("\n".join(positions))
    shutil.make_archive(str(folder / "photos"), "zip", folder / "PHOTOS")
    (folder / "KEYFILE").write_text("17" * 32)
    return folder


@pytest.fixture(scope="module")
def names(server: Server, client: Client, photos: Scan) -> Dict[str, str]:
    """What stands in a command for what only the server knows."""
    made = [
        client.reconstruct(part, name=name, camera=camera(), priors=photos.priors, preset="fast")
        for name, part in (
            ("first half", photos.files()[:10]),
            ("second half", photos.files()[5:15]),
        )
    ]
    one, other = (job.wait().id for job in made)
    imageset = made[1].info.request.imageset_ids[0]
    return {
        "MAP_A": one,
        "MAP_B": other,
        "MAP": one,
        "IMAGESET": imageset,
        "SERVER": server.url,
        "TOKEN": server.token,
        "MAVLINK": server.mavlink,
    }


def test_every_command_is_known() -> None:
    assert set(commands()) == {*RUN, *NOT_RUN}


@pytest.mark.parametrize("command", [command for command in commands() if command in RUN])
def test_a_command_runs(
    command: str, server: Server, folder: Path, names: Dict[str, str], tmp_path: Path
) -> None:
    run = RUN[command]
    line = command
    for documented, tried in run.change:
        assert documented in line
        line = line.replace(documented, tried)
    line = re.sub(r"\b[A-Z_]+\b", lambda word: names.get(word[0], word[0]), line)
    environment = server.environment()
    environment["PATH"] = f"{folder / 'bin'}:{os.environ['PATH']}"
    log = tmp_path / "log"
    with log.open("w") as out:
        shell = ["sh", "-c", line if run.ends else f"exec {line}"]
        process = subprocess.Popen(shell, cwd=folder, env=environment, stdout=out, stderr=out)
    if run.ends:
        assert process.wait(3 * PATIENCE) in DONE, log.read_text()
        assert run.says in log.read_text(), log.read_text()
    else:
        until(lambda: run.says in log.read_text() or process.poll() is not None, line)
        process.terminate()
        process.wait(PATIENCE)
        assert run.says in log.read_text(), log.read_text()
    if command == next(iter(RUN)):
        # What later commands begin with.
        shutil.copy(folder / "map" / "map.glb", folder)
        shutil.copy(folder / "map" / "transforms.json", folder)
        shutil.copytree(folder / "map" / "colmap", folder / "sparse" / "0")
