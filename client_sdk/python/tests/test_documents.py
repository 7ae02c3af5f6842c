"""Every Python snippet of the documents runs as it stands, with simulated drones."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from support.documents import blocks
from support.room import HALF, Room, Scan, camera, pose
from support.script import Script
from support.server import Field, Server

from volery import Client, Geofence, Map
from volery.photos import png
from volery.types import FenceBlock

SNIPPETS = blocks("python")


def test_there_are_snippets() -> None:
    assert len(SNIPPETS) >= 4


@pytest.mark.parametrize("source", [s for _, s in SNIPPETS], ids=[name for name, _ in SNIPPETS])
def test_a_snippet_runs(
    source: str,
    server: Server,
    client: Client,
    photos: Scan,
    hall: Map,
    room: Room,
    field: Field,
    tmp_path: Path,
) -> None:
    # What the snippets take for granted: photos of a room, and a fence that is high enough.
    (tmp_path / "photos").mkdir()
    named = {photos.files()[0]: "a.jpg", photos.files()[8]: "b.jpg"}
    for file in photos.files():
        shutil.copy(file, tmp_path / "photos" / named.get(file, file.name))
    (tmp_path / "photo.jpg").write_bytes(png(room.photo(pose((0.2, 0.1, 0.0), 1.0))))
    x, y = HALF[:2] - 0.1
    area = FenceBlock([(-x, -y), (x, -y), (x, y), (-x, y)], -0.5, 2.5)
    client.set_fence(Geofence(hall.id, area, margin_m=0.1))
    (tmp_path / "snippet.py").write_text(source)
    script = Script(server, tmp_path / "log", tmp_path / "snippet.py", folder=tmp_path)
    if ".poses()" not in source:
        script.finish()
        return
    # It follows a drone as long as it is let.
    with hall.stream(camera(), track=True, drone=field.ids[0]) as stream:
        for step in range(1, 200):
            if "tracking" in script.said():
                break
            stream.send(room.photo(pose((0.5, 0.2, 0.1), 0.4)), t_capture_ns=step * 100_000_000)
            stream.receive()
    script.until_said("tracking")
    script.process.kill()
    script.process.wait()
