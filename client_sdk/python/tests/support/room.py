"""A room with pictures on its walls, and a camera that looks at it: photos with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
from numpy.typing import NDArray

from volery import Camera, Prior
from volery.geometry import quaternion_from_rotation
from volery.photos import png
from volery.types import CameraPose, PositionPrior

Array = NDArray[np.float64]

#: Half the room's size, meters; x, y, z.
HALF = np.array([3.0, 2.5, 1.5])
#: Texels per meter of the pictures.
DENSITY = 60
WIDTH, HEIGHT, FOCAL = 320, 240, 200.0
#: The standard deviation that the priors state and have, meters.
PRIOR_SIGMA = 0.02


def camera() -> Camera:
    """The camera's calibration: no distortion."""
    return Camera("PINHOLE", WIDTH, HEIGHT, [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2])


def pose(position: Tuple[float, float, float], yaw: float, pitch: float = 0.0) -> CameraPose:
    """`map_from_camera` of a level camera that looks along `yaw`, turned up by `pitch`."""
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    rotation = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    return CameraPose(position, quaternion_from_rotation(rotation))


def _picture(rng: np.random.Generator, height: int, width: int) -> Array:
    """Noise of many sizes with posters on it, in 0..1, height x width x 3."""
    result = np.zeros((height, width, 3))
    for size, weight in ((4, 0.25), (9, 0.3), (24, 0.25), (60, 0.2)):
        coarse = rng.random((height // size + 2, width // size + 2, 3))
        y, x = np.arange(height) / size, np.arange(width) / size
        i, j = y.astype(int), x.astype(int)
        u, v = (y - i)[:, None, None], (x - j)[None, :, None]
        top = coarse[i][:, j] * (1 - v) + coarse[i][:, j + 1] * v
        low = coarse[i + 1][:, j] * (1 - v) + coarse[i + 1][:, j + 1] * v
        result += weight * (top * (1 - u) + low * u)
    for _ in range(height * width // 1500):
        y, x = rng.integers(0, [height - 8, width - 8])
        h, w = rng.integers(5, [40, 40])
        result[y : y + h, x : x + w] = rng.random(3)
    return result


class Room:
    """Six walls, each with its own picture."""

    def __init__(self, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self._rng = rng
        self._pictures = {}
        for axis in range(3):
            u, v = (a for a in range(3) if a != axis)
            size = (2 * HALF[[u, v]] * DENSITY).astype(int) + 1
            for side in (-1, 1):
                self._pictures[axis, side] = _picture(rng, *size)

    def photo(self, map_from_camera: CameraPose) -> NDArray[np.uint8]:
        """What the camera sees: height x width x 3. Four rays per pixel."""
        fine = [self._look(map_from_camera, dx, dy) for dx in (0.25, 0.75) for dy in (0.25, 0.75)]
        seen = np.mean(fine, axis=0) + self._rng.normal(0, 0.006, (HEIGHT, WIDTH, 3))
        result: NDArray[np.uint8] = (np.clip(seen, 0, 1) * 255).astype(np.uint8)
        return result

    def _look(self, map_from_camera: CameraPose, dx: float, dy: float) -> Array:
        x = (np.arange(WIDTH) + dx - WIDTH / 2) / FOCAL
        y = (np.arange(HEIGHT) + dy - HEIGHT / 2) / FOCAL
        rays = np.stack([*np.meshgrid(x, y), np.ones((HEIGHT, WIDTH))], axis=-1)
        rays = rays @ map_from_camera.rotation.T
        center = np.asarray(map_from_camera.position)
        with np.errstate(divide="ignore"):
            # The distance to the wall that each axis of a ray runs into.
            far = (np.sign(rays) * HALF - center) / rays
        axis_hit = np.argmin(far, axis=-1)
        hits = center + rays * np.min(far, axis=-1)[..., None]
        result = np.zeros((HEIGHT, WIDTH, 3))
        for (axis, side), picture in self._pictures.items():
            here = (axis_hit == axis) & (np.sign(rays[..., axis]) == side)
            u, v = (a for a in range(3) if a != axis)
            texel = ((hits[here][:, [u, v]] + HALF[[u, v]]) * DENSITY).astype(int)
            texel = np.clip(texel, 0, np.array(picture.shape[:2]) - 1)
            result[here] = picture[texel[:, 0], texel[:, 1]]
        return result


@dataclass(frozen=True)
class Scan:
    """Photos in a folder, and where they were taken."""

    folder: Path
    truth: Dict[str, CameraPose]
    priors: Dict[str, Prior]

    def files(self) -> List[Path]:
        """The photos by name."""
        return [self.folder / name for name in self.truth]


def scan(room: Room, folder: Path, count: int = 26) -> Scan:
    """A flight in a circle, looking outwards: one turn and a bit."""
    rng = np.random.default_rng(5)
    truth, priors = {}, {}
    for index in range(count):
        angle = 2.2 * np.pi * index / count
        place = (0.8 * np.cos(angle), 0.8 * np.sin(angle), 0.2 * np.sin(3 * angle))
        name = f"{index:03}.png"
        truth[name] = pose(place, angle + 0.4, 0.1 * np.sin(2 * angle))
        (folder / name).write_bytes(png(room.photo(truth[name])))
        noisy = tuple(float(v) for v in place + rng.normal(0, PRIOR_SIGMA, 3))
        priors[name] = Prior(position=PositionPrior(noisy, PRIOR_SIGMA))
    return Scan(folder, truth, priors)
