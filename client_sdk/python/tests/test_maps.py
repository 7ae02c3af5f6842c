"""Photos to a map, a photo to its pose, against the truth."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import List

import numpy as np
import pytest
from support.room import Room, Scan, camera, pose
from support.server import Server

from volery import AsyncClient, Client, KnownDistance, Map, errors
from volery.types import FrameTrackedMessage, JobEvent, UploadResult


def test_the_map_is_where_the_room_is(hall: Map, photos: Scan) -> None:
    assert hall.is_metric
    cameras = {image.image: image.pose for image in hall.cameras().images}
    assert len(cameras) == len(photos.truth)
    errors_m = [np.linalg.norm(cameras[n].matrix - p.matrix) for n, p in photos.truth.items()]
    # Priors err by 2 cm each; their mean by 2 cm / sqrt(20).
    assert np.median(errors_m) < 0.03
    points = hall.points()
    assert len(points) == hall.facts["num_points"]
    assert points.colors is not None and points.colors.dtype == np.uint8


@pytest.mark.parametrize("form", ["array", "gray", "file", "bytes"])
def test_a_photo_finds_its_pose(hall: Map, room: Room, tmp_path: Path, form: str) -> None:
    from volery.photos import png

    truth = pose((0.3, -0.4, 0.1), 2.0, 0.05)
    pixels = room.photo(truth)
    path = tmp_path / "photo.png"
    path.write_bytes(png(pixels))
    gray = (pixels @ [0.299, 0.587, 0.114]).astype(np.uint8)
    photo = {"array": pixels, "gray": gray, "file": path, "bytes": path.read_bytes()}[form]
    answer = hall.localize(photo, camera=camera())
    assert answer.status == "ok" and answer.pose is not None
    assert np.linalg.norm(answer.pose.matrix[:3, 3] - truth.position) < 0.05
    assert np.linalg.norm(answer.pose.rotation - truth.rotation) < 0.03
    assert answer.covariance is not None and len(answer.covariance) == 36


def test_a_photo_of_nothing_has_a_reason(hall: Map) -> None:
    answer = hall.localize(np.full((240, 320), 128, np.uint8), camera=camera())
    assert answer.status == "not_found" and answer.pose is None and answer.reason


def test_progress_speaks_of_every_photo_and_stage(
    client: Client, room: Room, photos: Scan, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.jpg"
    bad.write_bytes(b"no photo")
    told: List[UploadResult] = []
    names = list(photos.truth)[:12]
    job = client.reconstruct(
        [*(photos.folder / name for name in names), bad],
        camera=camera(),
        scale=KnownDistance(names[0], names[5], _distance(photos, names[0], names[5])),
        preset="fast",
        progress=lambda done, total, result: told.append(result),
    )
    assert [result.name for result in told] == [*names, "bad.jpg"]
    assert told[-1].status == "rejected" and told[-1].code
    assert job.upload is not None and job.upload.stored == 12 and job.upload.rejected == 1
    events: List[JobEvent] = []
    map = job.wait(progress=events.append)
    assert [event.seq for event in events] == list(range(1, len(events) + 1))
    assert events[-1].data["state"] == job.state
    assert map.is_metric and "known_distance" in str(map.facts["scale"])
    again = client.upload(job.info.request.imageset_ids[0], photos.folder / names[0])
    assert again.duplicates == 1


def _distance(photos: Scan, a: str, b: str) -> float:
    places = [np.array(photos.truth[name].position) for name in (a, b)]
    return float(np.linalg.norm(places[0] - places[1]))


def test_a_scan_of_nothing_says_why(client: Client, tmp_path: Path) -> None:
    from volery.photos import png

    (tmp_path / "empty.jpg").write_bytes(b"")
    with pytest.raises(errors.UploadRejected) as rejected:
        client.reconstruct(tmp_path)
    assert rejected.value.results[0].code == "empty_file"
    for index in range(3):
        (tmp_path / f"gray{index}.png").write_bytes(png(np.full((240, 320), 90 + index, np.uint8)))
    with pytest.raises(errors.JobFailed) as failed:
        client.reconstruct(tmp_path, camera=camera(), preset="fast").wait()
    assert failed.value.code and failed.value.job.state == "failed"
    with pytest.raises(FileNotFoundError):
        client.reconstruct(tmp_path / "absent.jpg")


def test_a_stream_follows_a_camera(hall: Map, room: Room) -> None:
    with hall.stream(camera(), track=True) as stream:
        for step in range(6):
            truth = pose((0.02 * step, 0.0, 0.0), 0.5 + 0.01 * step)
            seq = stream.send(room.photo(truth), t_capture_ns=1 + step * 100_000_000)
            answer = stream.receive()
            assert isinstance(answer, FrameTrackedMessage) and answer.seq == seq
            result = answer.result
    assert result.state == "tracking" and result.pose is not None
    assert np.linalg.norm(result.pose.matrix[:3, 3] - truth.position) < 0.05


def test_files_are_taken_along(hall: Map, tmp_path: Path) -> None:
    whole = hall.export("sparse.ply")
    assert hall.download("sparse.ply", tmp_path / "map.ply").read_bytes() == whole
    assert [path.name for path in tmp_path.iterdir()] == ["map.ply"]
    with pytest.raises(errors.NotFound):
        hall.download("absent.ply", tmp_path / "absent.ply")


def test_lists_are_walked_page_by_page(client: Client, hall: Map, photos: Scan) -> None:
    jobs = [job for job in client.jobs() if job.info.outputs and job.info.outputs.map_id == hall.id]
    imageset = jobs[0].info.request.imageset_ids[0]
    images = list(client.pages(client.api.list_images, imageset, limit=7))
    assert sorted(image.name for image in images) == list(photos.truth)
    first = client.api.list_images(imageset, limit=7)
    rest = list(client.pages(client.api.list_images, imageset, limit=7, cursor=first.next_cursor))
    assert [*first.items, *rest] == images


def test_the_async_face_does_the_same(server: Server, hall: Map, room: Room) -> None:
    async def main() -> None:
        async with AsyncClient(server.url, server.token) as client:
            map = await client.map(hall.id)
            answers = await asyncio.gather(
                *(
                    map.localize(room.photo(pose((0, 0, 0), yaw)), camera=camera())
                    for yaw in (1.0, 4.0)
                )
            )
            assert [answer.status for answer in answers] == ["ok", "ok"]
            job = (await client.jobs())[0]
            events = [event.seq async for event in job.events()]
            assert events == list(range(1, len(events) + 1))

    asyncio.run(main())


def test_maps_are_drawn(hall: Map) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    way = np.array([image.pose.position for image in hall.cameras().images])
    for view in ("3d", "top"):
        axes = hall.plot(view=view, trajectories={"scan": way})
        low, high = axes.get_xlim()
        # The room is 6 m long, and the points that are wrong do not stretch it.
        assert 5.5 < high - low < 7.5
    pyplot.close("all")
