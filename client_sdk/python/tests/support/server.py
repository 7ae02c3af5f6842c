"""The real server, and drones that fly over it on poses of their true places."""

from __future__ import annotations

import itertools
import json
import math
import os
import random
import re
import subprocess
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple, Type, TypeVar

from volery import Client
from volery.geometry import quaternion_from_yaw
from volery.types import DronePose

T = TypeVar("T")

#: Parameters of both autopilots that let drones land as fast as they climb, meters (or
#: centimeters) per second, and end there: tests wait for it.
QUICK_LANDING = {
    "WPNAV_SPEED_DN": 100,
    "LAND_SPEED": 100,
    "MPC_Z_VEL_MAX_DN": 1.0,
    "MPC_LAND_SPEED": 1.0,
    "COM_DISARM_LAND": 0.2,
}

REPOSITORY = Path(__file__).resolve().parents[4]
#: The server's program.
PROGRAM = Path(os.environ.get("VOLERY_BIN", REPOSITORY / "target" / "release" / "volery")).resolve()
#: Longest wait of a test, seconds.
PATIENCE = 40.0
#: What a tracker errs by, meters.
NOISE = 0.001


def until(look: Callable[[], Optional[T]], what: str, patience: float = PATIENCE) -> T:
    """Looks again and again until something is there."""
    deadline = time.monotonic() + patience
    while True:
        found = look()
        if found:
            return found
        assert time.monotonic() < deadline, f"{what}: not within {patience} s"
        time.sleep(0.02)


class Server:
    """`volery serve` on ports that the system chose."""

    def __init__(self, data: Path) -> None:
        assert PROGRAM.is_file(), f"{PROGRAM} is missing: cargo build --release, or set VOLERY_BIN"
        arguments = ["serve", "--data", str(data), "--listen", "127.0.0.1:0"]
        arguments += ["--mavlink", "udp:127.0.0.1:0", "--insecure-mavlink"]
        self._log = (data.parent / "server.log").open("w+")
        self._process = subprocess.Popen(
            [str(PROGRAM), *arguments], stdout=self._log, stderr=self._log
        )
        self.url = self._told(r"listens on (http://\S+)")
        self.mavlink = self._told(r"heard on udp:(\S+)")
        self.token = self._told(r"admin token .*: (\S+)")

    def _told(self, pattern: str) -> str:
        def look() -> Optional[str]:
            assert self._process.poll() is None, self.log()
            found = re.search(pattern, self.log())
            return found and found.group(1)

        return until(look, f"the server says {pattern}")

    def log(self) -> str:
        """What it said so far."""
        return Path(self._log.name).read_text()

    def client(self) -> Client:
        """A client that may do all."""
        return Client(self.url, self.token)

    def environment(self) -> Dict[str, str]:
        """For scripts."""
        return dict(os.environ, VOLERY_SERVER=self.url, VOLERY_TOKEN=self.token)

    def stop(self) -> None:
        """Ends it."""
        self._process.terminate()
        self._process.wait(PATIENCE)
        self._log.close()


class Field:
    """Simulated drones, and a tracker that tells the server where each truly is."""

    def __init__(
        self, server: Server, count: int, first: int = 1, start: str = "-1,-1.7,0"
    ) -> None:
        arguments = ["simulate", "--room", "open", "--flavor", "mixed", "--mavlink", server.mavlink]
        arguments += ["--drones", str(count), "--system-id", str(first), "--start", start]
        arguments += ["--spacing", "0,1.7,0", "--report", "20"]
        for name, value in QUICK_LANDING.items():
            arguments += ["--parameter", f"{name}={value}"]
        self.ids = list(range(first, first + count))
        self.truth: Dict[int, Any] = {}
        self._ended = threading.Event()
        self._start = math.inf
        self._process = subprocess.Popen(
            [str(PROGRAM), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self._threads: List[threading.Thread] = [threading.Thread(target=self._read, daemon=True)]
        for drone in self.ids:
            self._threads.append(
                threading.Thread(target=self._track, args=(server, drone), daemon=True)
            )
        for thread in self._threads:
            thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            state = json.loads(line)
            if "estimate" in state:
                state["heard"] = time.monotonic()
                self._start = min(self._start, state["heard"] - state["t"])
                self.truth[state["system_id"]] = state

    def _track(self, server: Server, drone: int) -> None:
        with server.client() as client:
            told = 0.0
            while not self._ended.wait(0.005):
                state = self.truth.get(drone)
                if state is None or state["heard"] == told:
                    continue
                told = state["heard"]
                age_ms = (time.monotonic() - told) * 1e3
                orientation = quaternion_from_yaw(state["yaw"])
                # Two poses are never the same: a camera that shows one picture again is broken.
                place = [v + random.uniform(-NOISE, NOISE) for v in state["position"]]
                client.api.drone_pose(drone, DronePose(place, orientation, age_ms, 0.02, 0.02))

    def watch(self, process: subprocess.Popen[Any]) -> Iterator[Tuple[int, int]]:
        """All pairs of drones, again and again until a process ends."""
        while process.poll() is None:
            yield from itertools.combinations(self.ids, 2)
            time.sleep(0.05)

    def clock(self) -> float:
        """Seconds as `t` in what the drones tell, also where a busy machine tells it late."""
        return time.monotonic() - self._start

    def speed(self, drone: int) -> float:
        """True speed, meters per second."""
        return math.hypot(*self.truth[drone]["velocity"])

    def place(self, drone: int) -> List[float]:
        """True place."""
        return list(self.truth[drone]["position"])

    def __enter__(self) -> Field:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self._ended.set()
        self._process.terminate()
        self._process.wait(PATIENCE)
        for thread in self._threads:
            thread.join(PATIENCE)
