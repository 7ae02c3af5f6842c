"""Maps in the hands of others: numpy, pycolmap, Open3D, trimesh, where they are installed."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, List, Optional, Tuple

from ._optional import numpy, optional
from .errors import Misunderstood

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: Scalar types of PLY as numpy's.
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class Cloud:
    """Points of a map, in the map: right-handed, z up, meters when the map is metric."""

    positions: NDArray[np.float64]
    """n x 3."""
    colors: Optional[NDArray[np.uint8]]
    """n x 3, red, green, blue."""
    normals: Optional[NDArray[np.float64]]
    """n x 3, unit length."""

    def __len__(self) -> int:
        return len(self.positions)


def read_ply_points(data: bytes) -> Cloud:
    """The vertices of a binary little-endian PLY file."""
    np = numpy("points of a map")
    end = data.find(b"end_header\n")
    lines = data[: max(end, 0)].decode("ascii", "replace").split("\n")
    if lines[0].strip() != "ply" or "format binary_little_endian 1.0" not in [
        line.strip() for line in lines
    ]:
        raise Misunderstood("not a binary little-endian PLY file")
    count, fields = 0, []
    element = ""
    for line in lines:
        words = line.split()
        if words[:1] == ["element"]:
            element = words[1]
            count = int(words[2]) if element == "vertex" else count
        elif words[:1] == ["property"] and element == "vertex":
            fields.append((words[2], "<" + _PLY_TYPES[words[1]]))
    vertices = np.frombuffer(data, np.dtype(fields), count, end + len(b"end_header\n"))

    def columns(names: Tuple[str, ...], kind: str) -> Any:
        if not set(names) <= set(vertices.dtype.names or ()):
            return None
        return np.stack([vertices[name] for name in names], axis=1).astype(kind)

    positions = columns(("x", "y", "z"), "f8")
    if positions is None:
        raise Misunderstood("a PLY file without x, y, z")
    return Cloud(
        positions, columns(("red", "green", "blue"), "u1"), columns(("nx", "ny", "nz"), "f8")
    )


def as_open3d(cloud: Cloud) -> Any:
    """A cloud as `open3d.geometry.PointCloud`."""
    open3d = optional("open3d", "Open3D clouds")
    result = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.positions))
    if cloud.colors is not None:
        result.colors = open3d.utility.Vector3dVector(cloud.colors / 255.0)
    if cloud.normals is not None:
        result.normals = open3d.utility.Vector3dVector(cloud.normals)
    return result


def as_trimesh(glb: bytes) -> Any:
    """A GLB file as `trimesh.Scene` in the frame `map`: the turn to glTF's y up is taken back."""
    from .geometry import gltf_from_map

    trimesh = optional("trimesh", "meshes as trimesh")
    scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    scene.apply_transform(gltf_from_map().T)
    return scene


def as_pycolmap(archive: bytes, folder: Path) -> Any:
    """`colmap.zip`, unpacked into a folder, as `pycolmap.Reconstruction`."""
    pycolmap = optional("pycolmap", "COLMAP models")
    with zipfile.ZipFile(io.BytesIO(archive)) as files:
        files.extractall(folder)
    return pycolmap.Reconstruction(str(model_folder(folder)))


def model_folder(folder: Path) -> Path:
    """Where in a folder the COLMAP model is."""
    found: List[Path] = sorted(folder.rglob("cameras.bin")) + sorted(folder.rglob("cameras.txt"))
    if not found:
        raise Misunderstood(f"{folder} holds no COLMAP model")
    return found[0].parent
