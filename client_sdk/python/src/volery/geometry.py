"""Rotations and poses as arrays.

Quaternions are Hamilton, `(w, x, y, z)`. A transform named `a_from_b` takes coordinates in b to
coordinates in a: `x_in_a = a_from_b @ x_in_b`, so that products chain by equal neighbors.

| frame | axes |
|---|---|
| map | right-handed, z up, x forward vector, y left; meters when the map is metric |
| camera | x right, y down, z forward through the lens |
| body | x forward, y left, z up |
| glTF | y up, z forward, x left |
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Sequence, Tuple, Union

from ._optional import numpy
from .wire import Wire

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Vector = Union[Sequence[float], NDArray[Any]]


def floats(values: Vector) -> Tuple[float, ...]:
    """Numbers of a list or an array."""
    return tuple(float(value) for value in values)


def rotation_from_quaternion(quaternion: Vector) -> Array:
    """3 x 3 rotation matrix of a quaternion `(w, x, y, z)`; its length does not matter."""
    np = numpy("rotation matrices")
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    result: Array = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return result


def quaternion_from_rotation(rotation: Any) -> Tuple[float, float, float, float]:
    """Unit quaternion `(w, x, y, z)`, w >= 0, of a 3 x 3 rotation matrix.

    The eigenvector of the largest eigenvalue of Bar-Itzhack's matrix: also right for a matrix that
    is only nearly a rotation.
    """
    np = numpy("quaternions")
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.asarray(rotation, float)
    bar_itzhack = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, yy - xx - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, zz - xx - yy],
        ]
    )
    quaternion = np.linalg.eigh(bar_itzhack)[1][:, -1]
    w, x, y, z = quaternion if quaternion[0] >= 0 else -quaternion
    return float(w), float(x), float(y), float(z)


def quaternion_from_yaw(yaw: float) -> Tuple[float, float, float, float]:
    """A turn about z (up), counter-clockwise from x, radians."""
    import math

    return math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)


def gltf_from_map() -> Array:
    """4 x 4; the turn that the root node of `map.glb` makes: (X, Y, Z) = (y, z, x)."""
    np = numpy("transforms")
    result: Array = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    return result


class Posed(Wire):
    """Something with a place and an orientation: `parent_from_own`."""

    position: Sequence[float]
    orientation: Sequence[float]

    @property
    def matrix(self) -> Array:
        """4 x 4, `parent_from_own`: takes own coordinates to the parent's, `map` unless the class
        says otherwise."""
        np = numpy("a pose as a matrix")
        result: Array = np.eye(4)
        result[:3, :3] = rotation_from_quaternion(self.orientation)
        result[:3, 3] = self.position
        return result

    @property
    def inverse(self) -> Array:
        """4 x 4, `own_from_parent`: for a camera, `cam_from_map` as COLMAP stores it."""
        np = numpy("a pose as a matrix")
        result: Array = np.linalg.inv(self.matrix)
        return result

    @property
    def rotation(self) -> Array:
        """3 x 3 part of `matrix`."""
        return rotation_from_quaternion(self.orientation)


def position_and_orientation(matrix: Any) -> Tuple[Tuple[float, ...], Tuple[float, ...]]:
    """Position and quaternion `(w, x, y, z)` of a 4 x 4 transform."""
    np = numpy("poses from matrices")
    matrix = np.asarray(matrix, float)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError(f"a pose is a finite 4 x 4 matrix, not of shape {matrix.shape}")
    return floats(matrix[:3, 3]), quaternion_from_rotation(matrix[:3, :3])
