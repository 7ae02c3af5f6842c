"""Maps and ways in matplotlib figures."""

from __future__ import annotations

from typing import Any, Literal, Mapping, Optional

from ._optional import numpy, optional
from .interop import Cloud
from .types import MapCameras

#: Points drawn at most: figures stay quick.
MAX_POINTS = 20_000


def plot_map(
    cloud: Cloud,
    cameras: Optional[MapCameras] = None,
    axes: Any = None,
    *,
    trajectories: Optional[Mapping[str, Any]] = None,
    view: Literal["top", "3d"] = "3d",
) -> Any:
    """Draws points, camera places and trajectories of one map and returns the axes.

    * `axes`: where to draw; a new figure when absent.
    * `trajectories`: by name, n x 3 places in the map, meters, or n x 4 x 4 poses `map_from_...`.
    * `view`: `3d`, or `top`: x to the right, y up the page.
    """
    np = numpy("plots")
    pyplot = optional("matplotlib.pyplot", "plots", "matplotlib")
    axes = axes or pyplot.figure().add_subplot(projection="3d" if view == "3d" else None)
    count = 3 if view == "3d" else 2
    step = max(1, -(-len(cloud) // MAX_POINTS))
    places = cloud.positions[::step]
    colors = "0.6" if cloud.colors is None else cloud.colors[::step] / 255.0
    axes.scatter(*places[:, :count].T, c=colors, s=1.0, linewidths=0)
    shown = [places]
    if cameras is not None and cameras.images:
        centers = np.array([image.pose.position for image in cameras.images])
        ahead = np.array([image.pose.rotation[:, 2] for image in cameras.images])
        length = 0.05 * float(np.linalg.norm(np.ptp(centers, axis=0))) or 0.1
        for center, direction in zip(centers, ahead):
            axes.plot(
                *np.stack([center, center + length * direction])[:, :count].T, color="C0", lw=1
            )
        axes.scatter(*centers[:, :count].T, color="C0", s=8, label="cameras")
        shown.append(centers)
    for name, way in (trajectories or {}).items():
        way = np.asarray(way, float)
        way = way[:, :3, 3] if way.ndim == 3 else way
        axes.plot(*way[:, :count].T, label=name)
        shown.append(way)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    if view == "3d":
        axes.set_zlabel("z (m)")
    # Far points that are few would shrink the room to a dot.
    low, high = np.percentile(np.concatenate(shown), [1, 99], axis=0)
    margin = 0.05 * float(np.max(high - low)) or 1.0
    for index, axis in enumerate("xyz"[:count]):
        getattr(axes, f"set_{axis}lim")(low[index] - margin, high[index] + margin)
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    return axes
