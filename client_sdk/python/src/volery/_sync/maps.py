# Written by generate.py; changes here are lost.
"""Maps: localize, look at, take along."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Union

from .. import types
from ..interop import Cloud, as_open3d, as_pycolmap, as_trimesh, read_ply_points
from ..photos import encoded
from ..plotting import plot_map
from ..types import (
    Aligned,
    AlignRequest,
    Camera,
    CameraPose,
    CreateJob,
    KnownDistance,
    KnownDistanceAlignment,
    LocalizeAnswer,
    LocalizeMethod,
    LocalizePrior,
    MapCameras,
    MapVersion,
    PatchMap,
    PositionPrior,
    RenderRequest,
    RenderWhat,
    StreamMode,
    StreamOpenRequest,
    YawPrior,
)
from ..wire import quoted
from .api import Api
from .http import Http
from .socket import Stream


class Map:
    """A map of the server. Its versions never change; the active one answers."""

    def __init__(self, http: Http, info: types.Map) -> None:
        self._http = http
        self._api = Api(http)
        self.info = info
        """As it was when it was last looked at."""

    def __repr__(self) -> str:
        metric = "metric" if self.is_metric else "not metric"
        return (
            f"<{type(self).__name__} {self.info.name!r} {self.id} version {self.version}, {metric}>"
        )

    @property
    def id(self) -> str:
        """Its id."""
        return self.info.id

    @property
    def version(self) -> int:
        """Its active version when it was last looked at."""
        return self.info.active_version

    @property
    def facts(self) -> Dict[str, Any]:
        """Scale, gravity, origin, quality and statistics of the active version."""
        return self.info.active.info

    @property
    def is_metric(self) -> bool:
        """Whether its unit is the meter. By another map no drone may be flown."""
        return bool(self.facts.get("scale", {}).get("metric"))

    def refresh(self) -> Map:
        """Looks at it."""
        self.info = self._api.get_map(self.id)
        return self

    def rename(self, name: str) -> Map:
        """Gives it another name."""
        self.info = self._api.patch_map(self.id, PatchMap(name=name))
        return self

    def delete(self) -> None:
        """Deletes it with all its versions."""
        self._api.delete_map(self.id)

    def versions(self) -> List[MapVersion]:
        """All its versions."""
        found: List[MapVersion] = []
        cursor = None
        while True:
            page = self._api.list_versions(self.id, limit=200, cursor=cursor)
            found.extend(page.items)
            cursor = page.next_cursor
            if cursor is None:
                return found

    def align(self, request: Union[AlignRequest, KnownDistance]) -> Aligned:
        """A new version in another frame or scale; it is active.

        `map.align(KnownDistance("a.jpg", "b.jpg", 3.0))` makes a map metric.
        """
        if isinstance(request, KnownDistance):
            request = KnownDistanceAlignment(request)
        aligned = self._api.align_map(self.id, request)
        self.refresh()
        return aligned

    def localize(
        self,
        photo: Any,
        *,
        camera: Optional[Camera] = None,
        near: Optional[Sequence[float]] = None,
        near_sigma: float = 0.5,
        yaw: Optional[float] = None,
        yaw_sigma: float = 0.2,
        method: Optional[LocalizeMethod] = None,
        version: Optional[int] = None,
    ) -> LocalizeAnswer:
        """The pose of a photo in the map, or the reason why it has none.

        * `photo`: a file, its bytes, or an array of uint8, height x width (x 3, RGB).
        * `camera`: its calibration; the map's own or EXIF when absent.
        * `near`: where it was taken, roughly: x, y, z in the map, meters; `near_sigma` is the
          standard deviation of each.
        * `yaw`: about the map's z axis, counter-clockwise from x, radians.

        A photo that cannot be placed is an answer: `status` is `not_found` or `ambiguous`, `reason`
        says why. `answer.pose.matrix` is `map_from_camera`, 4 x 4; `answer.covariance` has 6 x 6
        numbers by rows: position in the map (m), then rotation about the map's axes (rad).
        """
        prior = None
        if near is not None or yaw is not None:
            prior = LocalizePrior(
                position=None
                if near is None
                else PositionPrior([float(v) for v in near], near_sigma),
                yaw=None if yaw is None else YawPrior(yaw, yaw_sigma),
            )
        return self._api.localize(
            self.id, encoded(photo), camera=camera, pose_prior=prior, method=method, version=version
        )

    def stream(
        self,
        camera: Optional[Camera] = None,
        *,
        track: bool = False,
        drone: Optional[int] = None,
        feed: bool = False,
        mode: StreamMode = "latest",
    ) -> Stream:
        """A localization stream, for a `with` block: images in, poses out.

        * `camera`: intrinsics of all frames.
        * `track`: follow the camera from frame to frame; capture times must rise.
        * `drone`: whose camera it is: its poses are the drone's, on the topic `pose:<drone>`.
        * `feed`: send the poses to the drone's estimator; needs `track`, `drone` and a metric map.
        """
        return Stream(
            self._http,
            StreamOpenRequest(
                map_id=self.id,
                camera=camera,
                mode=mode,
                track=track,
                drone_id=None if drone is None else str(drone),
                feed=feed,
            ),
        )

    def cameras(self) -> MapCameras:
        """Its cameras and the poses of its images: `map_from_camera`."""
        return self._api.map_cameras(self.id)

    def points(self, dense: bool = False) -> Cloud:
        """Its points, in the map: `positions` n x 3 (m), `colors` n x 3 (uint8)."""
        name = "dense.ply" if dense else "sparse.ply"
        return read_ply_points(self.export(name))

    def render(
        self, pose: CameraPose, camera: Optional[Camera] = None, what: RenderWhat = "color"
    ) -> bytes:
        """What a virtual camera sees: a PNG, or for `depth_f32` meters along z, row by row."""
        return self._api.render(self.id, RenderRequest(pose, camera, what))

    def extend(self, imagesets: Sequence[str]) -> Any:
        """Queues the job by which photos join the map."""
        from .jobs import Job

        request = CreateJob(kind="extend_map", map_id=self.id, imageset_ids=imagesets)
        return Job(self._http, self._api.create_job(request))

    def export(self, name: str) -> bytes:
        """A file of the map: `colmap.zip`, `dense.ply`, `mesh.ply`, `map.glb`, `transforms.json`,
        `poses.csv`, ...; `client.info()` lists them."""
        return self._api.export(self.id, name)

    def download(self, name: str, path: Union[str, Path]) -> Path:
        """Writes a file of the map to disk; a connection that breaks is taken up where it broke."""
        url = f"/v1/maps/{quoted(self.id)}/export/{quoted(name)}"
        return self._http.download(url, {"version": self.version}, Path(path))

    def plot(self, axes: Any = None, **options: Any) -> Any:
        """Draws points and cameras with matplotlib; in notebooks it shows itself.

        `trajectories={"drone 1": array of n x 3}` draws ways, `view="top"` looks from above.
        """
        return plot_map(self.points(), self.cameras(), axes, **options)

    def to_colmap(self, name: str = "colmap_bin.zip") -> Any:
        """The map as `pycolmap.Reconstruction`, in the frame `map`."""
        with tempfile.TemporaryDirectory() as folder:
            return as_pycolmap(self.export(name), Path(folder))

    def to_open3d(self, dense: bool = True) -> Any:
        """The points as `open3d.geometry.PointCloud`, in the frame `map`."""
        return as_open3d(self.points(dense))

    def to_trimesh(self) -> Any:
        """The painted mesh as `trimesh.Scene`, in the frame `map` (z up)."""
        return as_trimesh(self.export("map.glb"))
