"""Rotations, frames and bytes: truths that need no server."""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Tuple

import numpy as np
import pytest
from support.room import pose

from volery import FlightGoal, errors
from volery._sync.flights import goal_of, listed_goals
from volery.geometry import (
    gltf_from_map,
    position_and_orientation,
    quaternion_from_rotation,
    quaternion_from_yaw,
    rotation_from_quaternion,
)
from volery.interop import read_ply_points
from volery.photos import batches, listed, png
from volery.types import (
    CameraMount,
    CreateJob,
    DroneCommand,
    FrameHeader,
    GotoCommand,
    LocalizeAnswer,
    ServerMessage,
)
from volery.wire import decode, image_frame, split_frame


def quaternions() -> np.ndarray:
    """Random unit quaternions, and the turns by pi where a root vanishes."""
    random = np.random.default_rng(3).normal(size=(100, 4))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    return np.vstack([random, np.eye(4)])


@pytest.mark.parametrize("quaternion", quaternions())
def test_quaternions_survive_a_matrix(quaternion: np.ndarray) -> None:
    rotation = rotation_from_quaternion(quaternion)
    assert np.allclose(rotation @ rotation.T, np.eye(3)) and np.linalg.det(rotation) > 0
    back = quaternion_from_rotation(rotation)
    assert abs(abs(np.dot(back, quaternion)) - 1) < 1e-12 and back[0] >= 0


def test_a_quaternion_turns_as_its_axis_says() -> None:
    """w first, right-handed: a quarter about z takes x to y."""
    quarter = rotation_from_quaternion((math.sqrt(0.5), 0, 0, math.sqrt(0.5)))
    assert np.allclose(quarter @ [1, 0, 0], [0, 1, 0])
    assert np.allclose(quarter, rotation_from_quaternion(quaternion_from_yaw(math.pi / 2)))


def test_a_camera_looks_along_z_with_y_down() -> None:
    camera = pose((1, 2, 3), 0.0)
    assert np.allclose(camera.rotation @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(camera.rotation @ [0, 1, 0], [0, 0, -1])
    assert np.allclose(camera.matrix @ camera.inverse, np.eye(4))
    assert np.allclose(camera.matrix[:3, 3], (1, 2, 3))
    position, orientation = position_and_orientation(camera.matrix)
    assert np.allclose(position, camera.position)
    assert np.allclose(orientation, camera.orientation)
    # The default mount of a camera looks along the nose: body x.
    mount = CameraMount((0, 0, 0), (0.5, -0.5, 0.5, -0.5))
    assert np.allclose(mount.rotation @ [0, 0, 1], [1, 0, 0])


def test_gltf_has_y_up() -> None:
    assert np.allclose(gltf_from_map() @ [1, 2, 3, 1], [2, 3, 1, 1])


@pytest.mark.parametrize("bad", [np.eye(3), np.full((4, 4), np.nan)])
def test_what_is_no_pose_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="4 x 4"):
        position_and_orientation(bad)


def test_what_is_unknown_is_left_out() -> None:
    assert CreateJob(imageset_ids=["a"]).to_json() == {"imageset_ids": ["a"]}
    goto = GotoCommand(np.array([1.0, 2.0, 3.0]), yaw=0.0)  # type: ignore[arg-type]
    assert goto.to_json() == {"position": [1.0, 2.0, 3.0], "yaw": 0.0, "type": "goto"}
    assert decode(DroneCommand, goto.to_json()) == GotoCommand((1.0, 2.0, 3.0), yaw=0.0)


def test_a_newer_server_may_say_more() -> None:
    answer = decode(
        LocalizeAnswer,
        {"status": "ok", "frame": "map", "map_id": "m", "map_version": 1, "later": {"x": 1}},
    )
    assert answer.status == "ok" and answer.pose is None and answer.rivals == ()
    with pytest.raises(KeyError):
        decode(ServerMessage, {"type": "later", "t_ns": 1})


def test_frames_survive_and_cuts_are_noticed() -> None:
    frame = image_frame(FrameHeader(stream_id=3, seq=7), b"pixels")
    assert frame[:4] == b"VY\x01\x01"
    kind, header, payload = split_frame(frame)
    assert (kind, header, payload) == (1, {"stream_id": 3, "seq": 7}, b"pixels")
    for length in range(len(frame) - len(b"pixels")):
        with pytest.raises(errors.Misunderstood):
            split_frame(frame[:length])


@pytest.mark.parametrize("shape", [(3, 5), (3, 5, 3)])
def test_pixels_survive_png(shape: Tuple[int, ...]) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, shape, dtype=np.uint8)
    data = png(pixels)
    at = data.index(b"IDAT")
    (size,) = struct.unpack(">I", data[at - 4 : at])
    rows = np.frombuffer(zlib.decompress(data[at + 4 : at + 4 + size]), np.uint8).reshape(3, -1)
    assert np.array_equal(rows[:, 1:].reshape(shape), pixels) and not rows[:, 0].any()
    with pytest.raises(ValueError, match="uint8"):
        png(pixels.astype(float))


def test_points_survive_ply() -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty double x\n"
    head += "property double y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
    head += "property uchar blue\nelement face 0\nproperty list uchar int i\nend_header\n"
    body = struct.pack("<ddfBBB", 1, 2, 3, 4, 5, 6) + struct.pack("<ddfBBB", -1, -2, -3, 7, 8, 9)
    cloud = read_ply_points(head.encode() + body)
    assert cloud.positions.tolist() == [[1, 2, 3], [-1, -2, -3]] and len(cloud) == 2
    assert cloud.colors is not None and cloud.colors.tolist() == [[4, 5, 6], [7, 8, 9]]
    with pytest.raises(errors.Misunderstood):
        read_ply_points(b"solid stl")


def test_goals_are_places_or_lists_of_them() -> None:
    assert listed_goals((0, 0, 1)) == [(0, 0, 1)]
    assert listed_goals([(0, 0, 1), (1, 0, 1)]) == [(0, 0, 1), (1, 0, 1)]
    assert listed_goals(FlightGoal((0, 0, 1))) == [FlightGoal((0, 0, 1))]
    assert len(listed_goals(np.zeros((2, 3)))) == 2 and len(listed_goals(np.zeros(3))) == 1
    assert goal_of(np.array([1, 2, 3, 0.5])) == FlightGoal((1.0, 2.0, 3.0), 0.5)


def test_uploads_go_in_batches(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path))
    for index in range(20):
        (folder / f"{index:02}.JPG").write_bytes(b"x")
    (folder / "notes.txt").write_text("not a photo")
    files = listed(folder)
    assert [file.name for file in files] == [f"{index:02}.JPG" for index in range(20)]
    assert [len(group) for group in batches(files)] == [16, 4]


def test_errors_say_what_to_do() -> None:
    error = errors.refusal({"code": "map_not_metric", "detail": "no", "hint": "align it"}, 409)
    assert isinstance(error, errors.Conflict) and error.hint == "align it"
    assert str(error) == "no (map_not_metric); align it"
    assert json.dumps(error.problem)
    assert isinstance(errors.refusal({}, 500), errors.ServerFailed)
