"""What the server exports is what others read: axes, scale and errors, in their own hands."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from support.room import HALF, Room, Scan, camera, pose

from volery import Client, Map
from volery.geometry import gltf_from_map
from volery.interop import as_open3d, as_pycolmap

#: The walls stand at +-HALF; the map's own error is that of its priors.
WALL_M = 0.08


@pytest.fixture(scope="module")
def meshed(client: Client, photos: Scan) -> Map:
    """A map with a mesh."""
    job = client.reconstruct(
        photos.folder, camera=camera(), priors=photos.priors, preset="fast", stages=["mesh"]
    )
    return job.wait(timeout=600)


def test_pycolmap_finds_the_same_errors(hall: Map, client: Client) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    report = json.loads(hall.export("report.json"))
    for name in ("colmap.zip", "colmap_bin.zip"):
        model = hall.to_colmap(name)
        assert isinstance(model, pycolmap.Reconstruction)
        assert model.num_reg_images() == report["num_registered"]
        assert model.num_points3D() == report["num_points"]
        assert model.compute_num_observations() == report["num_observations"]
        squared = [
            np.sum((image.project_point(model.points3D[point.point3D_id].xyz) - point.xy) ** 2)
            for image in model.images.values()
            for point in image.points2D
            if point.has_point3D()
        ]
        # Text keeps the places of keypoints to some digits.
        assert np.mean(np.sqrt(squared)) == pytest.approx(report["mean_reprojection_px"], rel=1e-3)
        assert model.compute_mean_reprojection_error() == pytest.approx(
            report["mean_reprojection_px"], rel=0.05
        ), "the mean over points rather than sightings"


def test_poses_are_the_same_everywhere(hall: Map, photos: Scan) -> None:
    pytest.importorskip("pycolmap")
    poses = {image.image: image.pose for image in hall.cameras().images}
    for image in hall.to_colmap().images.values():
        cam_from_map = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        assert np.allclose(cam_from_map, poses[image.name].inverse, atol=1e-6)
    # nerfstudio: a camera looks along -z with y up.
    camera_from_gl = np.diag([1.0, -1, -1, 1])
    transforms = json.loads(hall.export("transforms.json"))
    assert (transforms["w"], transforms["h"], transforms["fl_x"]) == (320, 240, 200.0)
    for frame in transforms["frames"]:
        pose = poses[Path(frame["file_path"]).name]
        assert np.allclose(frame["transform_matrix"], pose.matrix @ camera_from_gl, atol=1e-6)


def test_models_of_pycolmap_become_maps(
    hall: Map, client: Client, photos: Scan, room: Room, tmp_path: Path
) -> None:
    query = room.photo(pose((0.1, -0.1, 0.05), 0.9))
    pycolmap = pytest.importorskip("pycolmap")
    model = hall.to_colmap()
    poses = {image.image: image.pose for image in hall.cameras().images}
    # What COLMAP knows of a room has no meters and no up.
    model.transform(pycolmap.Sim3d(2.5, pycolmap.Rotation3d([0.5, 0.5, 0.5, 0.5]), [1, 2, 3]))
    model.write(str(tmp_path))
    job = client.reconstruct(photos.folder, name="theirs", model=tmp_path, preset="fast")
    theirs = job.wait(timeout=600)
    assert not theirs.info.active.info["scale"]["metric"]
    answer = theirs.localize(query, camera=camera())
    assert answer.status == "ok"

    # In meters with z up the frame stays, and a photo finds the place it has in our own map.
    transforms = tmp_path / "transforms.json"
    transforms.write_bytes(hall.export("transforms.json"))
    job = client.reconstruct(
        photos.folder, name="nerf", model=transforms, model_is_metric=True, preset="fast"
    )
    kept = job.wait(timeout=600)
    for image in kept.cameras().images:
        assert np.allclose(image.pose.matrix, poses[image.image].matrix, atol=1e-5)
    ours, again = (map.localize(query, camera=camera()) for map in (hall, kept))
    assert ours.pose is not None and again.pose is not None
    assert np.linalg.norm(np.subtract(ours.pose.position, again.pose.position)) < 0.02


def test_points_load_in_trimesh(hall: Map) -> None:
    trimesh = pytest.importorskip("trimesh")
    cloud = trimesh.load(io.BytesIO(hall.export("sparse.ply")), file_type="ply")
    points = hall.points()
    assert np.allclose(cloud.vertices, points.positions, atol=1e-6)
    assert points.colors is not None
    assert np.array_equal(cloud.colors[:, :3], points.colors)
    near_a_wall = np.min(np.abs(np.abs(points.positions) - HALF), axis=1) < WALL_M
    assert near_a_wall.mean() > 0.8


def test_meshes_load_in_trimesh(meshed: Map) -> None:
    trimesh = pytest.importorskip("trimesh")
    scene = meshed.to_trimesh()
    mesh = scene.to_geometry()
    raw = trimesh.load_scene(io.BytesIO(meshed.export("map.glb")), file_type="glb")
    # y up, z forward, x left, as glTF wants it; the map's z up for us.
    assert np.allclose(raw.extents, (gltf_from_map()[:3, :3] @ scene.extents), atol=1e-6)
    plain = trimesh.load(io.BytesIO(meshed.export("mesh.ply")), file_type="ply")
    assert np.allclose(plain.bounds, mesh.bounds, atol=1e-3)
    assert len(plain.faces) == len(mesh.faces) > 1000
    near_a_wall = np.min(np.abs(np.abs(plain.vertices) - HALF), axis=1) < WALL_M
    assert near_a_wall.mean() > 0.8
    # It is seen from inside: its faces look at the middle.
    inwards = np.einsum("ij,ij->i", plain.face_normals, -plain.triangles_center) > 0
    assert np.average(inwards, weights=plain.area_faces) > 0.9
    dense = meshed.points(dense=True)
    assert dense.normals is not None
    assert np.allclose(np.linalg.norm(dense.normals, axis=1), 1, atol=1e-3)


def test_all_loads_in_open3d(meshed: Map, tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d", reason="without open3d its loading is NOT TESTED")
    for name in ("sparse.ply", "mesh.ply", "map.glb"):
        (tmp_path / name).write_bytes(meshed.export(name))
    points = meshed.points()
    cloud = open3d.io.read_point_cloud(str(tmp_path / "sparse.ply"))
    assert np.allclose(np.asarray(cloud.points), points.positions, atol=1e-6)
    assert np.allclose(np.asarray(as_open3d(points).points), points.positions)
    plain = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    corners = np.asarray(plain.vertices)
    near_a_wall = np.min(np.abs(np.abs(corners) - HALF), axis=1) < WALL_M
    assert near_a_wall.mean() > 0.8
    # glTF: y up, z forward, x left.
    gltf = open3d.io.read_triangle_mesh(str(tmp_path / "map.glb"))
    moved = corners @ gltf_from_map()[:3, :3].T
    assert np.allclose(gltf.get_min_bound(), moved.min(axis=0), atol=1e-3)
    assert np.allclose(gltf.get_max_bound(), moved.max(axis=0), atol=1e-3)
    # Its own camera at a pose of transforms.json sees the walls where they are.
    transforms = json.loads(meshed.export("transforms.json"))
    calibration = np.array(
        [
            [transforms["fl_x"], 0, transforms["cx"]],
            [0, transforms["fl_y"], transforms["cy"]],
            [0, 0, 1],
        ]
    )
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(plain))
    for frame in transforms["frames"][::8]:
        map_from_camera = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1, -1, 1])
        rays = scene.create_rays_pinhole(
            calibration, np.linalg.inv(map_from_camera), transforms["w"], transforms["h"]
        )
        depth = scene.cast_rays(rays)["t_hit"].numpy()
        seen = np.isfinite(depth)
        assert seen.mean() > 0.8
        starts, ways = np.split(rays.numpy(), 2, axis=-1)
        assert np.allclose(starts[0, 0], map_from_camera[:3, 3], atol=1e-4)
        hits = (starts + depth[..., None] * ways)[seen]
        assert (np.min(np.abs(np.abs(hits) - HALF), axis=1) < WALL_M).mean() > 0.8


def test_a_model_without_its_files_is_named(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    import zipfile

    from volery import errors

    archive = io.BytesIO()
    zipfile.ZipFile(archive, "w").close()
    with pytest.raises(errors.Misunderstood, match="no COLMAP model"):
        as_pycolmap(archive.getvalue(), tmp_path)
