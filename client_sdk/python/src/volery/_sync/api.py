# Written by generate.py; changes here are lost.
"""Every operation of the API, one method each."""

from __future__ import annotations

from typing import Any, Dict, List, Literal, Optional, Union

from ..types import *
from ..wire import Page, compact, content, json_of, json_or_text, new_key, none, quoted, text
from .http import Http


class Api:
    """Every operation of the API, one method each, as `openapi.yaml` names them."""

    def __init__(self, http: Http) -> None:
        self._http = http

    def front_page(self) -> str:
        """The page of the ground station.

        `GET /`
        """
        return self._http.call("GET", "/", text)

    def healthz(self) -> Health:
        """Whether the process lives.

        `GET /healthz`
        """
        return self._http.call("GET", "/healthz", json_of(Health))

    def readyz(self) -> Health:
        """Whether the service can work: database, disk, worker program.

        `GET /readyz`
        """
        return self._http.call("GET", "/readyz", json_of(Health))

    def openapi_yaml(self) -> str:
        """This description.

        `GET /openapi.yaml`
        """
        return self._http.call("GET", "/openapi.yaml", text)

    def metrics(self) -> str:
        """Counters in the text format of Prometheus.

        `GET /metrics`
        """
        return self._http.call("GET", "/metrics", text)

    def info(self) -> Info:
        """What the service is, can do, and refuses.

        `GET /v1/info`
        """
        return self._http.call("GET", "/v1/info", json_of(Info))

    def list_tokens(self, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[Token]:
        """Lists tokens without their secrets.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/tokens`
        """
        return self._http.call("GET", "/v1/tokens", json_of(Page[Token]), query={"limit": limit, "cursor": cursor})

    def create_token(self, body: CreateToken) -> CreatedToken:
        """Makes a token. Its secret is in this answer and nowhere else.

        `POST /v1/tokens`
        """
        return self._http.call("POST", "/v1/tokens", json_of(CreatedToken), body=body)

    def delete_token(self, token_id: str) -> None:
        """Ends a token at once.

        `DELETE /v1/tokens/{id}`
        """
        return self._http.call("DELETE", f"/v1/tokens/{quoted(token_id)}", none)

    def audit(self, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[AuditEntry]:
        """Who did what when, newest first: every request that changed something or would have, but
        for what comes many times a second (poses, frames, renewals of leases). Kept for 90
        days.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/audit`
        """
        return self._http.call("GET", "/v1/audit", json_of(Page[AuditEntry]), query={"limit": limit, "cursor": cursor})

    def list_cameras(self, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[StoredCamera]:
        """Lists cameras.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/cameras`
        """
        return self._http.call("GET", "/v1/cameras", json_of(Page[StoredCamera]), query={"limit": limit, "cursor": cursor})

    def create_camera(self, body: CreateCamera, *, idempotency_key: Optional[str] = None) -> StoredCamera:
        """Keeps the intrinsics of a calibrated camera.

        * `idempotency_key`: Names this request

        `POST /v1/cameras`
        """
        return self._http.call("POST", "/v1/cameras", json_of(StoredCamera), key=idempotency_key or new_key(), body=body)

    def camera_models(self) -> List[CameraModel]:
        """Camera models with the order of their parameters.

        `GET /v1/cameras/models`
        """
        return self._http.call("GET", "/v1/cameras/models", json_of(List[CameraModel]))

    def get_camera(self, camera_id: str) -> StoredCamera:
        """One camera.

        `GET /v1/cameras/{id}`
        """
        return self._http.call("GET", f"/v1/cameras/{quoted(camera_id)}", json_of(StoredCamera))

    def put_camera(self, camera_id: str, body: CreateCamera) -> StoredCamera:
        """Replaces the name and the intrinsics of a camera. Jobs that start from now on use them;
        maps keep what they were made with.

        `PUT /v1/cameras/{id}`
        """
        return self._http.call("PUT", f"/v1/cameras/{quoted(camera_id)}", json_of(StoredCamera), body=body)

    def list_imagesets(self, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[ImageSet]:
        """Lists image sets.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/imagesets`
        """
        return self._http.call("GET", "/v1/imagesets", json_of(Page[ImageSet]), query={"limit": limit, "cursor": cursor})

    def create_imageset(self, body: CreateImageSet, *, idempotency_key: Optional[str] = None) -> ImageSet:
        """Makes an empty image set.

        * `idempotency_key`: Names this request

        `POST /v1/imagesets`
        """
        return self._http.call("POST", "/v1/imagesets", json_of(ImageSet), key=idempotency_key or new_key(), body=body)

    def get_imageset(self, imageset_id: str) -> ImageSet:
        """One image set.

        `GET /v1/imagesets/{id}`
        """
        return self._http.call("GET", f"/v1/imagesets/{quoted(imageset_id)}", json_of(ImageSet))

    def delete_imageset(self, imageset_id: str) -> None:
        """Deletes an image set with its images. Maps made of them stay.

        `DELETE /v1/imagesets/{id}`
        """
        return self._http.call("DELETE", f"/v1/imagesets/{quoted(imageset_id)}", none)

    def patch_imageset(self, imageset_id: str, body: PatchImageSet) -> ImageSet:
        """Changes what the body names.

        `PATCH /v1/imagesets/{id}`
        """
        return self._http.call("PATCH", f"/v1/imagesets/{quoted(imageset_id)}", json_of(ImageSet), body=body)

    def put_priors(self, imageset_id: str, body: Union[PutPriors, str]) -> PriorsReport:
        """Sets the priors of images, by name.

        A JSON body is `PutPriors`. A `text/csv` body is telemetry:
        `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m,x_m,y_m,z_m`, columns in any order,
        all but `image` optional; an attitude needs its three angles, a position its three
        coordinates.

        `PUT /v1/imagesets/{id}/priors`
        """
        return self._http.call("PUT", f"/v1/imagesets/{quoted(imageset_id)}/priors", json_of(PriorsReport), body=body)

    def get_image(self, image_id: str) -> Image:
        """One image.

        `GET /v1/images/{id}`
        """
        return self._http.call("GET", f"/v1/images/{quoted(image_id)}", json_of(Image))

    def delete_image(self, image_id: str) -> None:
        """Deletes an image. Maps made of it stay.

        `DELETE /v1/images/{id}`
        """
        return self._http.call("DELETE", f"/v1/images/{quoted(image_id)}", none)

    def image_bytes(self, image_id: str) -> bytes:
        """The bytes of an image, as they were sent.

        `GET /v1/images/{id}/bytes`
        """
        return self._http.call("GET", f"/v1/images/{quoted(image_id)}/bytes", content)

    def list_jobs(self, *, state: Optional[str] = None, kind: Optional[str] = None, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[Job]:
        """Lists jobs, oldest first.

        * `state`: Only jobs in this state: `queued`, `running`, `succeeded`, `partial`,
          `failed`,
        `cancelled`.
        * `kind`: Only jobs of this kind: `reconstruct`, `register_maps`, `extend_map`.
        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/jobs`
        """
        return self._http.call("GET", "/v1/jobs", json_of(Page[Job]), query={"state": state, "kind": kind, "limit": limit, "cursor": cursor})

    def create_job(self, body: CreateJob, *, idempotency_key: Optional[str] = None) -> Job:
        """Queues a job.

        * `idempotency_key`: Names this request

        `POST /v1/jobs`
        """
        return self._http.call("POST", "/v1/jobs", json_of(Job), key=idempotency_key or new_key(), body=body)

    def get_job(self, job_id: str) -> Job:
        """One job.

        `GET /v1/jobs/{id}`
        """
        return self._http.call("GET", f"/v1/jobs/{quoted(job_id)}", json_of(Job))

    def delete_job(self, job_id: str) -> None:
        """Forgets a finished job with its events and its work folder. Its map stays.

        `DELETE /v1/jobs/{id}`
        """
        return self._http.call("DELETE", f"/v1/jobs/{quoted(job_id)}", none)

    def job_events(self, job_id: str, *, after: Optional[int] = None, limit: Optional[int] = None) -> JobEvents:
        """What happened to a job, in order.

        * `after`: Events with greater numbers only.
        * `limit`: Most events to answer, 1 to 1000.

        `GET /v1/jobs/{id}/events`
        """
        return self._http.call("GET", f"/v1/jobs/{quoted(job_id)}/events", json_of(JobEvents), query={"after": after, "limit": limit})

    def job_log(self, job_id: str, *, after: Optional[int] = None, limit: Optional[int] = None, level: Optional[str] = None) -> str:
        """The whole log of a job as text, one line per entry.

        * `after`: Events with greater numbers only.
        * `limit`: Most events but progress to look at, 1 to 1000; all when absent.
        * `level`: Least weight of a line: `info`, `warn` or `error`.

        `GET /v1/jobs/{id}/log`
        """
        return self._http.call("GET", f"/v1/jobs/{quoted(job_id)}/log", text, query={"after": after, "limit": limit, "level": level})

    def job_report(self, job_id: str, *, html: bool = False) -> Any:
        """The report of a job: leads to the report of the map it made. A job that failed has one
        of its own, which says of every photo what was wrong. HTML for those who accept it, else
        JSON.

        `GET /v1/jobs/{id}/report`
        """
        return self._http.call("GET", f"/v1/jobs/{quoted(job_id)}/report", json_or_text, headers={"Accept": "text/html" if html else "application/json"})

    def presets(self) -> List[PresetInfo]:
        """What each preset means.

        `GET /v1/presets`
        """
        return self._http.call("GET", "/v1/presets", json_of(List[PresetInfo]))

    def options(self) -> List[JobOption]:
        """The numbers that a job may set in its `options`, with their ranges and defaults.

        `GET /v1/options`
        """
        return self._http.call("GET", "/v1/options", json_of(List[JobOption]))

    def list_maps(self, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[Map]:
        """Lists maps.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/maps`
        """
        return self._http.call("GET", "/v1/maps", json_of(Page[Map]), query={"limit": limit, "cursor": cursor})

    def register_maps(self, body: RegisterMaps, *, idempotency_key: Optional[str] = None) -> Job:
        """Queues a job that joins maps which share a part, as `POST /v1/jobs` with the kind
        `register_maps` does. What each pair of maps said of the other is in the report of the
        job.

        * `idempotency_key`: Names this request

        `POST /v1/maps:register`
        """
        return self._http.call("POST", "/v1/maps:register", json_of(Job), key=idempotency_key or new_key(), body=body)

    def get_map(self, map_id: str) -> Map:
        """One map with its active version.

        `GET /v1/maps/{id}`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}", json_of(Map))

    def delete_map(self, map_id: str) -> None:
        """Deletes a map with all its versions.

        `DELETE /v1/maps/{id}`
        """
        return self._http.call("DELETE", f"/v1/maps/{quoted(map_id)}", none)

    def patch_map(self, map_id: str, body: PatchMap) -> Map:
        """Renames a map.

        `PATCH /v1/maps/{id}`
        """
        return self._http.call("PATCH", f"/v1/maps/{quoted(map_id)}", json_of(Map), body=body)

    def list_versions(self, map_id: str, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[MapVersion]:
        """Lists the versions of a map.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/maps/{id}/versions`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}/versions", json_of(Page[MapVersion]), query={"limit": limit, "cursor": cursor})

    def map_cameras(self, map_id: str, *, version: Optional[int] = None) -> MapCameras:
        """The posed images of a map and its cameras.

        * `version`: The active one when absent.

        `GET /v1/maps/{id}/cameras`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}/cameras", json_of(MapCameras), query={"version": version})

    def get_flight(self, flight_id: str) -> Flight:
        """One flight: its plan, its state, what happened.

        `GET /v1/flights/{id}`
        """
        return self._http.call("GET", f"/v1/flights/{quoted(flight_id)}", json_of(Flight))

    def list_geofences(self) -> List[Geofence]:
        """The fences of all maps that have one.

        `GET /v1/geofences`
        """
        return self._http.call("GET", "/v1/geofences", json_of(List[Geofence]))

    def put_geofence(self, body: Geofence) -> Geofence:
        """Sets the fence of a map for flights planned from now on. Without one, flights keep 0.5 m
        inside the bounds of the map.

        `PUT /v1/geofences`
        """
        return self._http.call("PUT", "/v1/geofences", json_of(Geofence), body=body)

    def delete_geofence(self, geofence_id: str) -> None:
        """Takes the fence of a map away: flights planned from now on keep inside the bounds of the
        map.

        `DELETE /v1/geofences/{id}`
        """
        return self._http.call("DELETE", f"/v1/geofences/{quoted(geofence_id)}", none)

    def list_drones(self) -> Page[Drone]:
        """Lists drones that are registered or were heard.

        `GET /v1/drones`
        """
        return self._http.call("GET", "/v1/drones", json_of(Page[Drone]))

    def get_drone(self, drone_id: int) -> Drone:
        """One drone.

        `GET /v1/drones/{id}`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}", json_of(Drone))

    def put_drone(self, drone_id: int, body: PutDrone) -> Drone:
        """Registers a drone or replaces its settings. Drones need not be registered to be heard.

        `PUT /v1/drones/{id}`
        """
        return self._http.call("PUT", f"/v1/drones/{quoted(drone_id)}", json_of(Drone), body=body)

    def delete_drone(self, drone_id: int) -> None:
        """Takes the settings of a drone away, and its camera if it is pulled; one that is still
        heard stays in the list.

        `DELETE /v1/drones/{id}`
        """
        return self._http.call("DELETE", f"/v1/drones/{quoted(drone_id)}", none)

    def patch_drone(self, drone_id: int, body: PatchDrone) -> Drone:
        """Changes settings of a registered drone; what is not named stays, also its key.

        `PATCH /v1/drones/{id}`
        """
        return self._http.call("PATCH", f"/v1/drones/{quoted(drone_id)}", json_of(Drone), body=body)

    def drone_state(self, drone_id: int) -> DroneState:
        """What a drone says of itself, and what it is told.

        `GET /v1/drones/{id}/state`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}/state", json_of(DroneState))

    def drone_events(self, drone_id: int, *, after: Optional[int] = None, limit: Optional[int] = None) -> Page[DroneEvent]:
        """What happened to a drone lately.

        * `after`: Events with greater numbers only.
        * `limit`: Most events to answer, 1 to 1000.

        `GET /v1/drones/{id}/events`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}/events", json_of(Page[DroneEvent]), query={"after": after, "limit": limit})

    def drone_command(self, drone_id: int, command: int) -> DroneCommandStatus:
        """How far a command is.

        `GET /v1/drones/{id}/commands/{command}`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}/commands/{quoted(command)}", json_of(DroneCommandStatus))

    def drone_pose(self, drone_id: int, body: DronePose) -> DronePoseAnswer:
        """Tells where a drone is, from any source that knows it: the pose goes to the drone's
        estimator if it is fresh and where the drone's own motion can have brought it.

        `POST /v1/drones/{id}/pose`
        """
        return self._http.call("POST", f"/v1/drones/{quoted(drone_id)}/pose", json_of(DronePoseAnswer), body=body)

    def drone_camera(self, drone_id: int) -> DroneCamera:
        """The camera of a drone that is pulled, and how that goes.

        `GET /v1/drones/{id}/camera`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}/camera", json_of(DroneCamera))

    def put_drone_camera(self, drone_id: int, body: PutDroneCamera) -> DroneCamera:
        """Has the camera of a drone pulled, in place of the one before: its pictures are followed
        in the map as those of a stream with `track` and `drone_id`. It goes on until it is
        deleted, also after a new start of the service; a camera that is gone is tried again.

        `PUT /v1/drones/{id}/camera`
        """
        return self._http.call("PUT", f"/v1/drones/{quoted(drone_id)}/camera", json_of(DroneCamera), body=body)

    def delete_drone_camera(self, drone_id: int) -> None:
        """Pulls the camera of a drone no more.

        `DELETE /v1/drones/{id}/camera`
        """
        return self._http.call("DELETE", f"/v1/drones/{quoted(drone_id)}/camera", none)

    def newest_frame(self, drone_id: int) -> bytes:
        """The newest picture of a drone's camera, as it came: by a stream of a pilot that names
        the drone, from its camera that is pulled, or by `POST /v1/drones/{id}/frames`.

        `GET /v1/drones/{id}/frame`
        """
        return self._http.call("GET", f"/v1/drones/{quoted(drone_id)}/frame", content)

    def all_stop(self) -> AllStopped:
        """Stops every drone: those in flight stay where they are, motors on the ground go off. It
        waits for nothing.

        `POST /v1/all-stop`
        """
        return self._http.call("POST", "/v1/all-stop", json_of(AllStopped), repeatable=True)

    def recording_file(self, recording_id: str) -> bytes:
        """The file of a recording: a telemetry log as ground stations and pymavlink read it.

        `GET /v1/recordings/{id}`
        """
        return self._http.call("GET", f"/v1/recordings/{quoted(recording_id)}", content)

    def delete_recording(self, recording_id: str) -> None:
        """Ends a recording and deletes its file.

        `DELETE /v1/recordings/{id}`
        """
        return self._http.call("DELETE", f"/v1/recordings/{quoted(recording_id)}", none)

    def list_leases(self) -> Page[Lease]:
        """Leases that are not over.

        `GET /v1/leases`
        """
        return self._http.call("GET", "/v1/leases", json_of(Page[Lease]))

    def create_lease(self, body: CreateLease, *, idempotency_key: Optional[str] = None) -> Lease:
        """Takes drones: nobody else commands them while the lease lasts, and they hold when it is
        over. `POST /v1/all-stop` needs no lease.

        * `idempotency_key`: Names this request

        `POST /v1/leases`
        """
        return self._http.call("POST", "/v1/leases", json_of(Lease), key=idempotency_key or new_key(), body=body)

    def renew_lease(self, lease_id: str) -> Lease:
        """Renews a lease: from now on it lasts for its whole time again.

        `POST /v1/leases/{id}/renew`
        """
        return self._http.call("POST", f"/v1/leases/{quoted(lease_id)}/renew", json_of(Lease))

    def delete_lease(self, lease_id: str) -> None:
        """Ends a lease: its drones hold.

        `DELETE /v1/leases/{id}`
        """
        return self._http.call("DELETE", f"/v1/leases/{quoted(lease_id)}", none)

    def estimate(self, body: BeaconEstimateRequest) -> BeaconEstimate:
        """The position that explains readings of beacons best: with their strengths as radio does
        it, with distances as sound does it, with a measured height in three dimensions.

        `POST /v1/beacons/estimate`
        """
        return self._http.call("POST", "/v1/beacons/estimate", json_of(BeaconEstimate), body=body, repeatable=True)

    def cancel_job(self, job_id: str, *, idempotency_key: Optional[str] = None) -> Job:
        """Ends a waiting job, or asks a running one to stop at its next unit of work.

        * `idempotency_key`: Names this request

        `POST /v1/jobs/{id}/cancel`
        """
        return self._http.call("POST", f"/v1/jobs/{quoted(job_id)}/cancel", json_of(Job), key=idempotency_key or new_key())

    def retry_job(self, job_id: str, *, from_stage: Optional[str] = None, idempotency_key: Optional[str] = None) -> Job:
        """Runs a failed, cancelled or partial job again. What it has finished is not done again,
        but for `from_stage` and what comes after it.

        * `from_stage`: Does this stage and all after it anew, whatever is finished of them:
          `features`, `pairs`,
        `matching`, `mapping`, `align`, `export`, `depth_maps`, `fusion`, `meshing`,
          `texturing`.
        * `idempotency_key`: Names this request

        `POST /v1/jobs/{id}/retry`
        """
        return self._http.call("POST", f"/v1/jobs/{quoted(job_id)}/retry", json_of(Job), key=idempotency_key or new_key(), query={"from_stage": from_stage})

    def activate_version(self, map_id: str, body: ActivateMap, *, idempotency_key: Optional[str] = None) -> Map:
        """Makes a version answer from now on.

        * `idempotency_key`: Names this request

        `POST /v1/maps/{id}/activate`
        """
        return self._http.call("POST", f"/v1/maps/{quoted(map_id)}/activate", json_of(Map), key=idempotency_key or new_key(), body=body)

    def list_flights(self) -> List[Flight]:
        """All flights since the service started, the oldest first.

        `GET /v1/flights`
        """
        return self._http.call("GET", "/v1/flights", json_of(List[Flight]))

    def create_flight(self, body: CreateFlight, *, idempotency_key: Optional[str] = None) -> Flight:
        """Plans a flight and checks the plan as a whole: speeds, distances between drones, fence.
        A plan that breaks a rule is refused with the rule, the drones, the time and the place.

        * `idempotency_key`: Names this request

        `POST /v1/flights`
        """
        return self._http.call("POST", "/v1/flights", json_of(Flight), key=idempotency_key or new_key(), body=body)

    def start_flight(self, flight_id: str, *, idempotency_key: Optional[str] = None) -> Flight:
        """Takes off with those who stand beneath their starts, and flies when all are there.

        * `idempotency_key`: Names this request

        `POST /v1/flights/{id}/start`
        """
        return self._http.call("POST", f"/v1/flights/{quoted(flight_id)}/start", json_of(Flight), key=idempotency_key, repeatable=False)

    def pause_flight(self, flight_id: str, *, idempotency_key: Optional[str] = None) -> Flight:
        """Everybody waits in the air.

        * `idempotency_key`: Names this request

        `POST /v1/flights/{id}/pause`
        """
        return self._http.call("POST", f"/v1/flights/{quoted(flight_id)}/pause", json_of(Flight), key=idempotency_key or new_key())

    def resume_flight(self, flight_id: str, *, idempotency_key: Optional[str] = None) -> Flight:
        """Goes on after a pause.

        * `idempotency_key`: Names this request

        `POST /v1/flights/{id}/resume`
        """
        return self._http.call("POST", f"/v1/flights/{quoted(flight_id)}/resume", json_of(Flight), key=idempotency_key, repeatable=False)

    def abort_flight(self, flight_id: str, *, idempotency_key: Optional[str] = None) -> Flight:
        """Everybody lands, one above another waiting until the place beneath is free.

        * `idempotency_key`: Names this request

        `POST /v1/flights/{id}/abort`
        """
        return self._http.call("POST", f"/v1/flights/{quoted(flight_id)}/abort", json_of(Flight), key=idempotency_key or new_key())

    def command_drone(self, drone_id: int, body: DroneCommand, *, idempotency_key: Optional[str] = None) -> DroneCommandStatus:
        """Commands a drone. The newest command takes the place of the one before.

        * `idempotency_key`: Names this request

        `POST /v1/drones/{id}/commands`
        """
        return self._http.call("POST", f"/v1/drones/{quoted(drone_id)}/commands", json_of(DroneCommandStatus), key=idempotency_key, body=body, repeatable=False)

    def fly_to_target(self, drone_id: int, body: CreateTarget, *, idempotency_key: Optional[str] = None) -> Target:
        """Flies a drone that hovers to a place, by legs that are checked before: `dry_run` only
        tells them. A newer target takes the place of the one before.

        * `idempotency_key`: Names this request

        `POST /v1/drones/{id}/target`
        """
        return self._http.call("POST", f"/v1/drones/{quoted(drone_id)}/target", json_of(Target), key=idempotency_key, body=body, repeatable=False)

    def list_recordings(self) -> Page[Recording]:
        """All recordings, the oldest first.

        `GET /v1/recordings`
        """
        return self._http.call("GET", "/v1/recordings", json_of(Page[Recording]))

    def start_recording(self, body: CreateRecording, *, idempotency_key: Optional[str] = None) -> Recording:
        """Records everything that a drone's link sends and receives, from now on.

        * `idempotency_key`: Names this request

        `POST /v1/recordings`
        """
        return self._http.call("POST", "/v1/recordings", json_of(Recording), key=idempotency_key or new_key(), body=body)

    def stop_recording(self, recording_id: str, *, idempotency_key: Optional[str] = None) -> Recording:
        """Ends a recording.

        * `idempotency_key`: Names this request

        `POST /v1/recordings/{id}/stop`
        """
        return self._http.call("POST", f"/v1/recordings/{quoted(recording_id)}/stop", json_of(Recording), key=idempotency_key or new_key())

    def list_images(self, imageset_id: str, *, limit: Optional[int] = None, cursor: Optional[str] = None) -> Page[Image]:
        """Lists the images of a set.

        * `limit`: Most items to answer, 1 to 1000; 100 when absent.
        * `cursor`: `next_cursor` of the page before.

        `GET /v1/imagesets/{id}/images`
        """
        return self._http.call("GET", f"/v1/imagesets/{quoted(imageset_id)}/images", json_of(Page[Image]), query={"limit": limit, "cursor": cursor})

    def upload_images(self, imageset_id: str, data: bytes, *, image_name: Optional[str] = None, pose_prior: Optional[Prior] = None, capture_time_ns: Optional[int] = None) -> UploadReport:
        """Adds photos to a set.

        A `multipart/form-data` body holds any number of files; each answers for itself. An
        `image/jpeg`, `image/png` or `application/octet-stream` body is one photo. What is
        answered `stored` or `duplicate` survives any crash.

        * `image_name`: Name of a single photo
        * `pose_prior`: `Prior` of a single photo, as JSON
        * `capture_time_ns`: Of a single photo, Unix epoch

        `POST /v1/imagesets/{id}/images`
        """
        return self._http.call("POST", f"/v1/imagesets/{quoted(imageset_id)}/images", json_of(UploadReport), body=data, repeatable=True, headers={"Content-Type": "application/octet-stream", "X-Image-Name": image_name, "X-Pose-Prior": compact(pose_prior), "X-Capture-Time-Ns": capture_time_ns})

    def upload_archive(self, imageset_id: str, data: bytes) -> UploadReport:
        """Adds the photos of a zip archive to a set. Entries that are no photos, links and names
        that lead out of the archive are rejected one by one.

        `POST /v1/imagesets/{id}/archive`
        """
        return self._http.call("POST", f"/v1/imagesets/{quoted(imageset_id)}/archive", json_of(UploadReport), body=data, headers={"Content-Type": "application/zip"})

    def put_model(self, imageset_id: str, body: Union[Dict[str, Any], bytes]) -> ModelReport:
        """Sets the poses and cameras of images to those of another program's model of them.

        An `application/zip` body holds COLMAP's `cameras` and `images`, `.txt` or `.bin`, in
        any folder; `application/json` is a `transforms.json`. Names of images may differ in
        folders and extensions. Other priors of the images stay. Jobs look at the poses with
        `poses: given` or `given_metric`.

        `PUT /v1/imagesets/{id}/model`
        """
        return self._http.call("PUT", f"/v1/imagesets/{quoted(imageset_id)}/model", json_of(ModelReport), body=body, headers={"Content-Type": "application/zip" if isinstance(body, bytes) else None})

    def create_upload(self, body: CreateUpload, *, idempotency_key: Optional[str] = None) -> Upload:
        """Begins the upload of a zip archive in parts.

        `PATCH` adds parts, one after another; what is answered of a part survives any crash.
        After a broken connection `GET` (or `HEAD`, by the header `Upload-Offset`) tells where
        to go on. `complete` takes the photos into the set. An upload that is three days old is
        forgotten.

        * `idempotency_key`: Names this request

        `POST /v1/uploads`
        """
        return self._http.call("POST", "/v1/uploads", json_of(Upload), key=idempotency_key or new_key(), body=body)

    def get_upload(self, upload_id: str) -> Upload:
        """How far an upload is.

        `GET /v1/uploads/{id}`
        """
        return self._http.call("GET", f"/v1/uploads/{quoted(upload_id)}", json_of(Upload))

    def delete_upload(self, upload_id: str) -> None:
        """Forgets an upload. Photos that are in their set stay.

        `DELETE /v1/uploads/{id}`
        """
        return self._http.call("DELETE", f"/v1/uploads/{quoted(upload_id)}", none)

    def append_part(self, upload_id: str, data: bytes, *, upload_offset: Optional[int] = None) -> Upload:
        """Adds a part to an upload, at the byte that `Upload-Offset` names: the one after the last
        that is there. Also of a part that breaks off, what came is kept.

        * `upload_offset`: Where in the file the part begins

        `PATCH /v1/uploads/{id}`
        """
        return self._http.call("PATCH", f"/v1/uploads/{quoted(upload_id)}", json_of(Upload), body=data, headers={"Content-Type": "application/octet-stream", "Upload-Offset": upload_offset})

    def complete_upload(self, upload_id: str) -> UploadReport:
        """Takes the photos of an uploaded archive into its set. Asked again, it answers the same.

        `POST /v1/uploads/{id}/complete`
        """
        return self._http.call("POST", f"/v1/uploads/{quoted(upload_id)}/complete", json_of(UploadReport))

    def image_thumbnail(self, image_id: str, *, size: Optional[int] = None) -> bytes:
        """A small PNG of an image, upright, never enlarged.

        * `size`: Longest side, pixels: 64, 128, 256, 512 or 1024; 256 when absent.

        `GET /v1/images/{id}/thumbnail`
        """
        return self._http.call("GET", f"/v1/images/{quoted(image_id)}/thumbnail", content, query={"size": size})

    def align_map(self, map_id: str, body: AlignRequest, *, version: Optional[int] = None, idempotency_key: Optional[str] = None) -> Aligned:
        """Makes a new version in another frame or scale, from a known distance, a similarity or
        surveyed points. The new version is active.

        * `version`: The active one when absent.
        * `idempotency_key`: Names this request

        `POST /v1/maps/{id}/align`
        """
        return self._http.call("POST", f"/v1/maps/{quoted(map_id)}/align", json_of(Aligned), key=idempotency_key or new_key(), body=body, query={"version": version})

    def map_points(self, map_id: str, *, version: Optional[int] = None) -> bytes:
        """The points of a map as PLY.

        * `version`: The active one when absent.

        `GET /v1/maps/{id}/points`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}/points", content, query={"version": version})

    def map_free_space(self, map_id: str, *, version: Optional[int] = None) -> bytes:
        """Where the air of a map is free: `VOLOCC01`, then as f64 the rotation of the grid in the
        map (quaternion w x y z), its origin (the least corner of the first voxel) and the edge
        of a voxel, as u32 the voxels along x, y and z, then runs of equal states, x first: u8
        (0 unseen, 1 free, 2 occupied) and their number as LEB128. All little endian. Outside of
        the grid all is unseen.

        * `version`: The active one when absent.

        `GET /v1/maps/{id}/freespace`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}/freespace", content, query={"version": version})

    def export(self, map_id: str, name: str, *, version: Optional[int] = None) -> bytes:
        """A file of a map. `ETag`, `Range` and `If-None-Match` are honored.

        * `version`: The active one when absent.

        `GET /v1/maps/{id}/export/{name}`
        """
        return self._http.call("GET", f"/v1/maps/{quoted(map_id)}/export/{quoted(name)}", content, query={"version": version})

    def localize(self, map_id: str, data: bytes, *, version: Optional[int] = None, method: Optional[Literal["auto", "pnp", "template"]] = None, camera: Optional[Camera] = None, pose_prior: Optional[LocalizePrior] = None) -> LocalizeAnswer:
        """Finds the pose of a photo. A photo that cannot be placed is answered 200 with
        `not_found` or `ambiguous` and the reason.

        * `version`: The active one when absent.
        * `method`: `auto` when absent.
        * `camera`: `Camera` of a raw photo, as JSON
        * `pose_prior`: `LocalizePrior` of a raw photo, as JSON

        `POST /v1/maps/{id}/localize`
        """
        return self._http.call("POST", f"/v1/maps/{quoted(map_id)}/localize", json_of(LocalizeAnswer), body=data, repeatable=True, query={"version": version, "method": method}, headers={"Content-Type": "application/octet-stream", "X-Camera": compact(camera), "X-Pose-Prior": compact(pose_prior)})

    def drone_frame(self, drone_id: int, data: bytes, *, map_id: Optional[str] = None, age_ms: Optional[float] = None, extend: Optional[bool] = None, camera: Optional[Camera] = None, pose_prior: Optional[LocalizePrior] = None) -> FrameAnswer:
        """Takes one frame of a drone's camera, as at the end of a way: its place is found by the
        features of the frame alone, told to the drone's estimator if it is fresh and can be
        true, and noted in the drone's flight. With `extend` a frame that has a place joins the
        map by a job.

        * `map_id`: Where to look.
        * `age_ms`: Since the frame was taken, milliseconds; 0 when absent.
        * `extend`: Whether the frame joins the map, if it has a place in it: a job makes a new
          version.
        * `camera`: `Camera` of the frame, as JSON
        * `pose_prior`: `LocalizePrior` of the frame, as JSON

        `POST /v1/drones/{id}/frames`
        """
        return self._http.call("POST", f"/v1/drones/{quoted(drone_id)}/frames", json_of(FrameAnswer), body=data, query={"map_id": map_id, "age_ms": age_ms, "extend": extend}, headers={"Content-Type": "application/octet-stream", "X-Camera": compact(camera), "X-Pose-Prior": compact(pose_prior)})

    def localize_in_maps(self, data: bytes, *, map_ids: Optional[str] = None, method: Optional[Literal["auto", "pnp", "template"]] = None, camera: Optional[Camera] = None, pose_prior: Optional[LocalizePrior] = None) -> LocalizeManyAnswer:
        """Finds the pose of a photo in one of several maps.

        * `map_ids`: Ids of 1 to 8 different maps, separated by commas; or as a part of the
          form.
        * `method`: `auto` when absent.
        * `camera`: `Camera` of a raw photo, as JSON
        * `pose_prior`: `LocalizePrior` of a raw photo, as JSON

        `POST /v1/localize`
        """
        return self._http.call("POST", "/v1/localize", json_of(LocalizeManyAnswer), body=data, repeatable=True, query={"map_ids": map_ids, "method": method}, headers={"Content-Type": "application/octet-stream", "X-Camera": compact(camera), "X-Pose-Prior": compact(pose_prior)})

    def render(self, map_id: str, body: RenderRequest, *, version: Optional[int] = None) -> bytes:
        """Draws a view of a map: its mesh, or its points while it has none.

        * `version`: The active one when absent.

        `POST /v1/maps/{id}/render`
        """
        return self._http.call("POST", f"/v1/maps/{quoted(map_id)}/render", content, body=body, repeatable=True, query={"version": version})
