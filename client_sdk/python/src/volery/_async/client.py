"""The server, and everything that begins with it."""

from __future__ import annotations

from types import TracebackType
from typing import (
    Any,
    AsyncIterator,
    Awaitable,
    Callable,
    List,
    Mapping,
    Optional,
    Sequence,
    Type,
    TypeVar,
    Union,
)

from ..errors import UploadRejected
from ..models import ModelSource, model_body
from ..photos import Photos, batches, encoded, listed, parts
from ..progress import Progress, progress_of
from ..types import (
    AlertMessage,
    Camera,
    CreateImageSet,
    CreateJob,
    DroneAlert,
    Geofence,
    ImageSet,
    Info,
    JobState,
    KnownDistance,
    LocalizeManyAnswer,
    LocalizeMethod,
    LocalizePrior,
    OriginRule,
    PoseSource,
    Preset,
    Prior,
    PutPriors,
    RegisterMaps,
    RegistrationMethod,
    StageGroup,
    UploadReport,
    UploadResult,
)
from ..wire import Page, json_of, quoted
from .api import AsyncApi
from .concurrency import in_order
from .drones import AsyncDrone
from .flights import AsyncFlight, fitting_map, plan_of
from .http import READ_TIMEOUT, AsyncHttp
from .jobs import AsyncJob
from .lease import DEFAULT_TTL, AsyncLease
from .maps import AsyncMap
from .socket import topic_messages

T = TypeVar("T")

#: Requests with photos under way at once.
PARALLEL_UPLOADS = 3
#: Items of one page.
PAGE = 200


class AsyncClient:
    """A Volery server.

    ```python
    async with AsyncClient("http://127.0.0.1:8420", token="...") as client:
        job = await client.reconstruct("photos/", scale=KnownDistance("a.jpg", "b.jpg", 3.0))
        map = await job.wait(progress=True)
        answer = await map.localize("photo.jpg")
    ```

    * `server`: `http://HOST:PORT`; when absent, the environment's `VOLERY_SERVER`, else this
      machine's port 8420.
    * `token`: the environment's `VOLERY_TOKEN` when absent.
    * `timeout`: longest wait for the next bytes of an answer, seconds.

    `client.api` has every operation of the API under the name that `openapi.yaml` gives it.
    """

    def __init__(
        self,
        server: Optional[str] = None,
        token: Optional[str] = None,
        *,
        timeout: float = READ_TIMEOUT,
    ) -> None:
        self._http = AsyncHttp(server, token, timeout)
        self.api = AsyncApi(self._http)

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Closes all connections."""
        await self._http.aclose()

    @property
    def server(self) -> str:
        """The server's address."""
        return self._http.base

    async def info(self) -> Info:
        """What the server is, can do, and refuses."""
        return await self.api.info()

    async def pages(
        self, list_page: Callable[..., Awaitable[Page[T]]], *ids: Any, **query: Any
    ) -> AsyncIterator[T]:
        """All items of a paged list, page by page as they are asked for.

        `client.pages(client.api.list_images, imageset_id)`. To go on where an earlier walk ended,
        give its `cursor`.
        """
        query.setdefault("limit", PAGE)
        while True:
            page = await list_page(*ids, **query)
            for item in page.items:
                yield item
            if page.next_cursor is None:
                return
            query["cursor"] = page.next_cursor

    # Photos to maps.

    async def upload(
        self,
        imageset: Union[str, ImageSet],
        photos: Photos,
        *,
        progress: Progress = False,
    ) -> UploadReport:
        """Uploads photos into an image set, some at a time.

        * `photos`: a folder, a file, or files. Their file names are their names in the set.
        * `progress`: `True` for a line on standard error, or a function that takes how many are
          done, how many there are, and what became of the latest `UploadResult`.

        A photo that the server refuses does not stop the others: `results` says why, in the order
        of the files. Uploading again is safe: the set knows its photos by their content.
        """
        imageset_id = imageset if isinstance(imageset, str) else imageset.id
        files = listed(photos)
        path = f"/v1/imagesets/{quoted(imageset_id)}/images"
        results: List[UploadResult] = []

        async def send(group: Any) -> UploadReport:
            return await self._http.call(
                "POST", path, json_of(UploadReport), files=parts(group), repeatable=True
            )

        with progress_of(progress, "upload", len(files)) as tell:
            async for report in in_order(send, batches(files), PARALLEL_UPLOADS):
                for result in report.results:
                    results.append(result)
                    tell(len(results), result)
        count = [
            sum(r.status == status for r in results)
            for status in ("stored", "duplicate", "rejected")
        ]
        return UploadReport(tuple(results), *count)

    async def reconstruct(
        self,
        photos: Photos,
        *,
        name: Optional[str] = None,
        scale: Union[None, KnownDistance, Sequence[KnownDistance]] = None,
        camera: Optional[Camera] = None,
        priors: Optional[Mapping[str, Prior]] = None,
        model: Optional[ModelSource] = None,
        model_is_metric: bool = False,
        preset: Preset = "balanced",
        stages: Sequence[StageGroup] = (),
        origin: Optional[OriginRule] = None,
        seed: int = 0,
        progress: Progress = False,
    ) -> AsyncJob:
        """Uploads photos and queues the job that makes a map of them: `.wait()` gives the map.

        * `photos`: a folder or files.
        * `scale`: measured distances between the cameras of two photos, meters. Without scale and
          without `priors` the map has no unit, and no drone may be flown by it.
        * `camera`: calibration of all photos; from EXIF and refined when absent.
        * `priors`: by file name, what the drone knew: attitude, height, position.
        * `model`: poses and cameras that another program found, taken as they are: a folder with
          COLMAP's `cameras` and `images`, `.txt` or `.bin`, a zip archive of it, or a
          `transforms.json`. Its frame stays if `model_is_metric`: meters with z up.
        * `preset`: `fast` ends with the sparse map, `balanced` and `best` with a painted mesh.
        * `stages`: ends earlier or later than the preset.
        """
        paths = listed(photos)
        name = name or paths[0].resolve().parent.name
        imageset = await self.api.create_imageset(CreateImageSet(name=name))
        report = await self.upload(imageset, paths, progress=progress)
        if report.stored + report.duplicates == 0:
            reasons = ", ".join(sorted({result.code or "rejected" for result in report.results}))
            raise UploadRejected(f"no photo was taken: {reasons}", results=report.results)
        if priors:
            await self.api.put_priors(imageset.id, PutPriors(dict(priors)))
        poses: PoseSource = "estimated"
        if model is not None:
            await self.api.put_model(imageset.id, model_body(model))
            poses = "given_metric" if model_is_metric else "given"
        distances = [scale] if isinstance(scale, KnownDistance) else list(scale or ())
        job = await self.job(
            CreateJob(
                imageset_ids=[imageset.id],
                map_name=name,
                camera=camera,
                known_distances=distances,
                poses=poses,
                preset=preset,
                stages=stages,
                origin=origin,
                seed=seed,
            )
        )
        job.upload = report
        return job

    async def job(self, job: Union[str, CreateJob]) -> AsyncJob:
        """A job by its id, or a new one."""
        if isinstance(job, str):
            return AsyncJob(self._http, await self.api.get_job(job))
        return AsyncJob(self._http, await self.api.create_job(job))

    async def jobs(self, state: Optional[JobState] = None) -> List[AsyncJob]:
        """All jobs, or those in one state, oldest first."""
        found = self.pages(self.api.list_jobs, state=state)
        return [AsyncJob(self._http, job) async for job in found]

    async def map(self, map_id: str) -> AsyncMap:
        """A map by its id."""
        return AsyncMap(self._http, await self.api.get_map(map_id))

    async def maps(self) -> List[AsyncMap]:
        """All maps."""
        return [AsyncMap(self._http, map) async for map in self.pages(self.api.list_maps)]

    async def register(
        self,
        maps: Sequence[Union[str, AsyncMap]],
        *,
        method: RegistrationMethod = "auto",
        with_scale: bool = False,
        name: Optional[str] = None,
    ) -> AsyncJob:
        """Queues the job that joins maps which share a part, in the frame of the first."""
        ids = [map if isinstance(map, str) else map.id for map in maps]
        request = RegisterMaps(maps=ids, method=method, with_scale=with_scale, map_name=name)
        job = await self.api.register_maps(request)
        return AsyncJob(self._http, job)

    async def localize(
        self,
        photo: Any,
        maps: Sequence[Union[str, AsyncMap]],
        *,
        camera: Optional[Camera] = None,
        prior: Optional[LocalizePrior] = None,
        method: Optional[LocalizeMethod] = None,
    ) -> LocalizeManyAnswer:
        """The pose of a photo in the one of several maps that knows it best."""
        ids = ",".join(map if isinstance(map, str) else map.id for map in maps)
        return await self.api.localize_in_maps(
            encoded(photo), map_ids=ids, camera=camera, pose_prior=prior, method=method
        )

    # Drones.

    async def drone(self, drone_id: int) -> AsyncDrone:
        """A drone by its MAVLink system id."""
        return AsyncDrone(self._http, await self.api.get_drone(drone_id))

    async def drones(self) -> List[AsyncDrone]:
        """Drones that are registered or were heard."""
        return [AsyncDrone(self._http, drone) for drone in (await self.api.list_drones()).items]

    def lease(
        self,
        drones: Sequence[Union[int, AsyncDrone]],
        *,
        map: Union[None, str, AsyncMap] = None,
        ttl: float = DEFAULT_TTL,
    ) -> AsyncLease:
        """Takes drones for a `with` block: nobody else commands them in it.

        ```python
        async with client.lease([1, 2, 3]) as group:
            await group.fly({1: (0, 0, 1.5), 2: (1, 0, 1.5), 3: (2, 0, 1.5)})
        ```

        The lease is kept alive in the background. When the block is left, or the script dies, the
        drones hold within `ttl` seconds, and land half a minute later if nobody takes them.

        * `map`: whose frame goals are in; when absent, the one that the environment's `VOLERY_MAP`
          names, else the only metric map of the server.
        """
        ids = [drone if isinstance(drone, int) else drone.id for drone in drones]
        return AsyncLease(
            self._http, ids, map if map is None or isinstance(map, str) else map.id, ttl
        )

    async def plan(
        self,
        goals: Mapping[Any, Any],
        *,
        map: Union[None, str, AsyncMap] = None,
        **options: Any,
    ) -> AsyncFlight:
        """Plans a flight and checks the plan, without flying it; see `AsyncLease.fly`."""
        map_id = map if isinstance(map, str) else map.id if map else await fitting_map(self.api)
        request = await plan_of(self.api, map_id, goals, **options)
        return AsyncFlight(self._http, await self.api.create_flight(request))

    async def all_stop(self) -> int:
        """Stops every drone at once: motors off, they fall. Answers how many were armed."""
        return len((await self.api.all_stop()).commands)

    async def set_fence(self, fence: Geofence) -> Geofence:
        """Fences a map: flights that leave it are not planned."""
        return await self.api.put_geofence(fence)

    async def alerts(self) -> AsyncIterator[DroneAlert]:
        """What somebody should look at, as it happens."""
        async for message in topic_messages(self._http, "alerts"):
            if isinstance(message, AlertMessage):
                yield message.alert

    async def default_map(self) -> AsyncMap:
        """The map that `VOLERY_MAP` names, else the only metric map of the server."""
        return await self.map(await fitting_map(self.api))
