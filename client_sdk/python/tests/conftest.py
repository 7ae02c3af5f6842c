"""One server, one scan, one map and one group of drones for all tests."""

from __future__ import annotations

import os
from typing import Iterator

import pytest
from support.room import HALF, Room, Scan, camera, scan
from support.server import Field, Server, until

from volery import Client, Geofence, Map
from volery.types import FenceBlock

CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The real server."""
    server = Server(tmp_path_factory.mktemp("server") / "data")
    yield server
    server.stop()


@pytest.fixture(scope="session")
def client(server: Server) -> Iterator[Client]:
    """A client that may do all."""
    with server.client() as client:
        yield client


@pytest.fixture(scope="session")
def room() -> Room:
    """A room."""
    return Room()


@pytest.fixture(scope="session")
def photos(room: Room, tmp_path_factory: pytest.TempPathFactory) -> Scan:
    """Photos of the room."""
    return scan(room, tmp_path_factory.mktemp("scan"))


@pytest.fixture(scope="session")
def hall(client: Client, photos: Scan) -> Map:
    """A metric map of the room, in its frame."""
    job = client.reconstruct(photos.folder, camera=camera(), priors=photos.priors, preset="fast")
    map = job.wait()
    os.environ["VOLERY_MAP"] = map.id
    outline = [(x * (HALF[0] - 0.1), y * (HALF[1] - 0.1)) for x, y in CORNERS]
    client.set_fence(Geofence(map.id, FenceBlock(outline, -0.5, 1.5), margin_m=0.1))
    return map


@pytest.fixture(scope="session")
def all_drones(server: Server) -> Iterator[Field]:
    """Three drones."""
    with Field(server, 3) as field:
        yield field


@pytest.fixture
def field(client: Client, all_drones: Field) -> Iterator[Field]:
    """Three drones on the ground whose estimators know where they are; they land after the test."""
    until(lambda: all(_is_ready(client, drone) for drone in all_drones.ids), "drones are ready")
    yield all_drones
    for drone in all_drones.ids:
        if all_drones.truth[drone]["armed"]:
            client.drone(drone).land()
    until(lambda: not any(all_drones.truth[d]["armed"] for d in all_drones.ids), "all landed")


def _is_ready(client: Client, drone: int) -> bool:
    known = [known for known in client.api.list_drones().items if known.id == drone]
    state = known[0].state if known else None
    # A drone that just landed is told to land until the server hears that it has.
    return state is not None and state.feed == "ready" and not state.armed
