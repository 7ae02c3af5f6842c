# Written by generate.py; changes here are lost.
"""What the server takes and gives: one class per schema of `openapi.yaml`.

SI units, angles in radians. The frame `map` is right-handed with z up, a camera looks along z with
x right and y down, a body has x forward, y left, z up. Quaternions are w, x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Literal, Optional, Sequence, Union

from .geometry import Posed
from .wire import Wire

@dataclass(frozen=True)
class ActivateMap(Wire):
    """Which version answers from now on."""

    version: int
    """An existing version."""


@dataclass(frozen=True)
class KnownDistanceAlignment(Wire):
    """Sets the scale."""

    known_distance: KnownDistance
    """Sets the scale."""


@dataclass(frozen=True)
class Sim3Alignment(Wire):
    """Sets rotation, translation and scale."""

    sim3: Sim3
    """Sets rotation, translation and scale."""


@dataclass(frozen=True)
class ControlPointsAlignment(Wire):
    """Fits rotation, translation and scale to at least three surveyed points."""

    control_points: Sequence[ControlPoint]
    """Fits rotation, translation and scale to at least three surveyed points."""


AlignRequest = Union[
    KnownDistanceAlignment,
    Sim3Alignment,
    ControlPointsAlignment,
]
"""Exactly one way to change the frame of a map."""


@dataclass(frozen=True)
class Aligned(Wire):
    """What an alignment made."""

    version: MapVersion
    """The new version; it is active."""
    residuals: Dict[str, Any]
    """How well the measurements fit."""


@dataclass(frozen=True)
class AllStopped(Wire):
    """Drones that were stopped."""

    commands: Sequence[DroneCommandStatus]
    """One command per drone that was armed."""


@dataclass(frozen=True)
class AttitudePrior(Wire):
    """Attitude of the camera as a drone reports it (camera along the nose)."""

    yaw: float
    """Heading, radians clockwise from the local frame's +y (north)."""
    pitch: Optional[float] = None
    """Nose up, radians."""
    roll: Optional[float] = None
    """Right side down, radians."""
    sigma_yaw: Optional[float] = None
    """Standard deviation of yaw, radians."""
    sigma_tilt: Optional[float] = None
    """Standard deviation of pitch and of roll, radians."""


@dataclass(frozen=True)
class AuditEntry(Wire):
    """A request that changed something, or would have."""

    time: str
    """When it was answered, RFC 3339."""
    name: str
    """Of the token."""
    role: Role
    """Of the token."""
    method: str
    """Of HTTP; `WS` for a message over a socket."""
    path: str
    """What was asked for."""
    status: int
    """How it was answered; 400 and more was not done."""
    token_id: Optional[str] = None
    """Whose; absent for a caller from this machine without one."""
    detail: Optional[str] = None
    """What a drone was commanded to do, or what was said over a socket, JSON."""


@dataclass(frozen=True)
class BeaconEstimate(Wire):
    """A position by beacons."""

    position: Sequence[float]
    """In the map, meters: x and y, and z if a height was measured."""
    sigma: Sequence[float]
    """Standard deviation of each coordinate, meters."""


@dataclass(frozen=True)
class BeaconEstimateRequest(Wire):
    """Readings of at least three beacons that do not stand on a line."""

    readings: Sequence[BeaconReading]
    """One per beacon."""
    path_loss: Optional[PathLossModel] = None
    """For `rssi_dbm`; -59 dBm, 2.2, 4 dB when absent."""
    height: Optional[float] = None
    """Height at which the position is sought, in the map, meters."""
    height_tof_m: Optional[float] = None
    """Distance straight down to the floor, meters: makes the position three-dimensional."""
    floor: Optional[float] = None
    """Height of the floor in the map, meters."""


@dataclass(frozen=True)
class BeaconReading(Wire):
    """What is measured of a beacon."""

    beacon: Sequence[float]
    """Where the beacon is, in the map, meters."""
    rssi_dbm: Optional[float] = None
    """Strength of its signal, dBm; or `range_m`."""
    range_m: Optional[float] = None
    """Distance to it, meters; or `rssi_dbm`."""
    sigma_m: Optional[float] = None
    """Standard deviation of the distance, meters; 0.05 when absent."""


@dataclass(frozen=True)
class Camera(Wire):
    """Intrinsics under COLMAP's names and parameter order, first pixel center at (0.5, 0.5)."""

    model: str
    """`SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL`, `OPENCV`, `OPENCV_FISHEYE` or
    `FULL_OPENCV`.
    """
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    params: Sequence[float]
    """In the order of the model, pixels for focal lengths and principal point."""


@dataclass(frozen=True)
class CameraModel(Wire):
    """A camera model and the order of its parameters."""

    model: str
    """COLMAP's name."""
    params: Sequence[str]
    """Names in order."""


@dataclass(frozen=True)
class CameraMount(Posed):
    """Where a camera sits on a drone and where it looks: `body_from_camera`."""

    position: Sequence[float]
    """Place of the camera in the body (x forward, y left, z up), meters."""
    orientation: Sequence[float]
    """Unit quaternion w, x, y, z that turns camera axes (x right, y down, z forward) into the
    body's.
    """


@dataclass(frozen=True)
class CameraPose(Posed):
    """Position and orientation of a camera in the map: `map_from_camera`."""

    position: Sequence[float]
    """x, y, z in the map, meters when the map is metric."""
    orientation: Sequence[float]
    """Unit quaternion w, x, y, z that turns camera axes (x right, y down, z forward) into the
    map's.
    """


@dataclass(frozen=True)
class Capabilities(Wire):
    """What the service can do."""

    stages: Sequence[str]
    """Groups of stages a job may ask for."""
    localizers: Sequence[str]
    """Ways to localize."""
    exports: Sequence[str]
    """Names under `export/`."""
    jobs: Sequence[str]
    """Kinds of jobs."""
    mavlink: bool
    """Whether it has a link to drones; without one, whatever concerns drones answers `no_mavlink`.
    """


@dataclass(frozen=True)
class SubscribeRequest(Wire):
    """Events of a topic."""

    topic: str
    """`jobs`, `job:<id>`; `pose:<drone>`; `drone:<drone>`, its states ten times a second and how
    its commands go; `flights`, `flight:<id>`; `alerts`. `*` in place of a drone means all.
    """
    after: Optional[int] = None
    """Events of the job with greater numbers only, past ones too; without it, from now on."""
    type: Literal["subscribe"] = "subscribe"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class UnsubscribeRequest(Wire):
    """No more events of a topic."""

    topic: str
    """As subscribed."""
    type: Literal["unsubscribe"] = "unsubscribe"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class StreamOpenRequest(Wire):
    """Opens a localization stream."""

    map_id: str
    """Where to look."""
    version: Optional[int] = None
    """The active one when absent; it stays the same for the life of the stream."""
    camera: Optional[Camera] = None
    """Intrinsics of all frames."""
    mode: Optional[StreamMode] = None
    """What to do with frames that come faster than answers."""
    track: Optional[bool] = None
    """Follow the camera from frame to frame: frames are answered with `frame.tracked`. All of them
    must be of one size and have rising capture times.
    """
    drone_id: Optional[str] = None
    """The drone whose camera this is; with `track`, its poses are the drone's."""
    feed: Optional[bool] = None
    """Send the poses to the estimator of the drone, whose MAVLink system id `drone_id` then is.
    Needs `track`, a metric map and the role `pilot`.
    """
    type: Literal["stream.open"] = "stream.open"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class StreamCloseRequest(Wire):
    """Closes a localization stream."""

    stream_id: int
    """As opened."""
    type: Literal["stream.close"] = "stream.close"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class LeaseRequest(Wire):
    """Takes drones, as `POST /v1/leases` does. The lease is over when the socket is, too: its
    drones hold at once.
    """

    drones: Sequence[int]
    """Which drones, by MAVLink system id."""
    ttl_ms: int
    """How long the promise lasts without being renewed, milliseconds."""
    type: Literal["lease"] = "lease"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class LeaseRenewRequest(Wire):
    """Renews a lease."""

    lease_id: str
    """Which one."""
    type: Literal["lease.renew"] = "lease.renew"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class LeaseReleaseRequest(Wire):
    """Gives a lease back: its drones hold."""

    lease_id: str
    """Which one."""
    type: Literal["lease.release"] = "lease.release"
    id: Optional[str] = None
    """Made by the client."""


@dataclass(frozen=True)
class PingRequest(Wire):
    """Asks for a `pong`."""

    type: Literal["ping"] = "ping"
    id: Optional[str] = None
    """Made by the client."""


ClientMessage = Union[
    SubscribeRequest,
    UnsubscribeRequest,
    StreamOpenRequest,
    StreamCloseRequest,
    LeaseRequest,
    LeaseRenewRequest,
    LeaseReleaseRequest,
    PingRequest,
]
"""From the client."""


@dataclass(frozen=True)
class ControlObservation(Wire):
    """One sighting of a surveyed point."""

    image: str
    """Image name."""
    pixel: Sequence[float]
    """Pixels, first pixel center (0.5, 0.5)."""


@dataclass(frozen=True)
class ControlPoint(Wire):
    """A surveyed point and where it is seen."""

    position: Sequence[float]
    """x, y, z in meters, z up."""
    observations: Sequence[ControlObservation]
    """At least two sightings."""


@dataclass(frozen=True)
class CreateCamera(Wire):
    """A camera to keep."""

    name: str
    """For people."""
    camera: Camera
    """Intrinsics."""


@dataclass(frozen=True)
class CreateFlight(Wire):
    """A flight of one or more drones to be planned and checked."""

    map_id: str
    """The map whose frame the goals are in; it must be metric."""
    drones: Sequence[FlightDrone]
    """Who flies where."""
    style: Optional[FlightStyle] = None
    """How goals are approached."""
    exchange_goals: Optional[bool] = None
    """Whether drones may exchange their goals, for shorter ways."""
    separation_m: Optional[float] = None
    """Smallest distance between drones, heights counted half, meters; 1 when absent."""
    margin_m: Optional[float] = None
    """Distance planned beyond that for drones that lag, meters; 0.5 when absent."""
    speed: Optional[float] = None
    """Largest level speed, meters per second; 1 when absent."""
    views: Optional[bool] = None
    """Whether drones stop at views on the way that their frames can be compared with."""
    allow_unseen: Optional[bool] = None
    """Whether ways may lead where no camera has looked."""


@dataclass(frozen=True)
class CreateImageSet(Wire):
    """An image set to make."""

    name: str
    """For people."""
    camera_id: Optional[str] = None
    """Camera of all its images that have none of their own."""
    notes: Optional[str] = None
    """For people."""


@dataclass(frozen=True)
class CreateJob(Wire):
    """A job to do."""

    kind: Optional[JobKind] = None
    """What to do."""
    imageset_ids: Sequence[str] = ()
    """Whose images to use, in order: one at least, but for `register_maps`, which takes none.
    """
    map_ids: Sequence[str] = ()
    """With `register_maps`, the maps to join, two at least; the result is in the frame of the
    first.
    """
    registration: Optional[Registration] = None
    """With `register_maps`, how."""
    map_id: Optional[str] = None
    """The map that gets a new version; a new map when absent. With `extend_map`, the map that the
    photos join.
    """
    map_name: Optional[str] = None
    """Name of a new map."""
    camera: Optional[Camera] = None
    """Intrinsics of every image whose set names no camera; kept fixed."""
    known_distances: Sequence[KnownDistance] = ()
    """Measured distances between the cameras of two images."""
    preset: Optional[Preset] = None
    """How much work is spent."""
    seed: Optional[int] = None
    """Seed of every random choice."""
    origin: Optional[OriginRule] = None
    """Which point is the origin."""
    poses: Optional[PoseSource] = None
    """Where the poses of the photos come from."""
    options: Optional[JobOptions] = None
    """Numbers that differ from those of the preset."""
    stages: Sequence[StageGroup] = ()
    """How far to go: to the last one named, with all before it; where the preset ends when empty.
    """
    priority: Optional[int] = None
    """Higher first."""


@dataclass(frozen=True)
class CreateLease(Wire):
    """A promise to be there for drones: it has to be renewed before its time is over."""

    drones: Sequence[int]
    """Which drones, by MAVLink system id."""
    ttl_ms: int
    """How long the promise lasts without being renewed, milliseconds."""


@dataclass(frozen=True)
class CreateRecording(Wire):
    """A recording to start."""

    drone: int
    """MAVLink system id."""


@dataclass(frozen=True)
class CreateTarget(Wire):
    """A place for one drone to fly to from where it is."""

    map_id: str
    """The map whose frame the place is in; it must be metric."""
    position: Sequence[float]
    """In the map, meters."""
    yaw: Optional[float] = None
    """About the map's z axis, counter-clockwise from x, radians; along the way when absent."""
    style: Optional[FlightStyle] = None
    """How it is approached."""
    views: Optional[bool] = None
    """Whether the drone stops at views on the way that its frames can be compared with."""
    speed: Optional[float] = None
    """Largest level speed, meters per second; 1 when absent."""
    separation_m: Optional[float] = None
    """Smallest distance to other drones in the air, heights counted half, meters; 1 when absent.
    """
    allow_unseen: Optional[bool] = None
    """Whether the way may lead where no camera has looked."""
    dry_run: Optional[bool] = None
    """Only plan and check."""


@dataclass(frozen=True)
class CreateToken(Wire):
    """A token to be made."""

    name: str
    """Who or what it is for."""
    role: Role
    """What it may do."""
    expires_in_s: Optional[int] = None
    """Seconds until it ends; never, when absent."""


@dataclass(frozen=True)
class CreateUpload(Wire):
    """An archive to be uploaded in parts."""

    imageset_id: str
    """The image set that its photos go into."""
    size: int
    """Bytes of the whole file."""
    sha256: str
    """SHA-256 of the whole file, 64 lower-case hex digits."""


@dataclass(frozen=True)
class CreatedToken(Wire):
    """A token with its secret, which is shown this once."""

    id: str
    """Its id."""
    name: str
    """Who or what it is for."""
    role: Role
    """What it may do."""
    created: str
    """RFC 3339."""
    secret: str
    """Goes into `Authorization: Bearer ...`."""
    expires: Optional[str] = None
    """RFC 3339."""


@dataclass(frozen=True)
class Drone(Wire):
    """A drone that is registered, or was heard, or both."""

    id: int
    """Its MAVLink system id."""
    has_own_key: bool
    """Whether it has a key of its own."""
    vision: VisionMessage
    """How it takes poses."""
    body_from_camera: CameraMount
    """Its camera."""
    name: Optional[str] = None
    """As registered."""
    state: Optional[DroneState] = None
    """What it says; absent when it was not heard."""


@dataclass(frozen=True)
class DroneAlert(Wire):
    """Something about a drone that somebody should look at."""

    drone: int
    """System id of the drone."""
    t_ns: int
    """Nanoseconds since the Unix epoch."""
    code: str
    """What: `pose_stale`, `link_lost`, `lease_over`, `battery_low`, `too_close`, `pose_refused`,
    `control_taken`, `not_in_control`, `impostor`, `shared_address` and others.
    """
    flight_id: Optional[str] = None
    """The flight that it flies in, where the alert comes from the flight."""
    detail: Optional[str] = None
    """What the service does about it (`holds`, `lands`), or more about it."""


@dataclass(frozen=True)
class DroneCamera(Wire):
    """A camera that is pulled, and how that goes."""

    settings: PutDroneCamera
    """As they were put."""
    state: DroneCameraState
    """How it goes now."""
    frames: int
    """Pictures that came, since the camera was put or the service started."""
    dropped: int
    """Of them, those without an answer: a newer one came first, or they could not be read."""
    rate_hz: float
    """Pictures per second, of the last few seconds."""
    map_version: Optional[int] = None
    """The version that answers; `null` when the camera cannot be pulled."""
    last_frame_age_ms: Optional[float] = None
    """Since the last picture began to come, milliseconds."""
    last_error: Optional[DroneCameraError] = None
    """What went wrong last, however long ago."""


@dataclass(frozen=True)
class DroneCameraError(Wire):
    """What went wrong with a camera."""

    code: str
    """Stable."""
    detail: str
    """For people."""


DroneCameraState = Literal["connecting", "streaming", "failed"]
"""How the pulling of a camera goes."""


@dataclass(frozen=True)
class ArmCommand(Wire):
    """Motors on."""

    type: Literal["arm"] = "arm"


@dataclass(frozen=True)
class DisarmCommand(Wire):
    """Motors off, on the ground."""

    type: Literal["disarm"] = "disarm"


@dataclass(frozen=True)
class TakeoffCommand(Wire):
    """Motors on if they are not, up, and hover."""

    height: float
    """Above the place where it stands, meters."""
    type: Literal["takeoff"] = "takeoff"


@dataclass(frozen=True)
class GotoCommand(Wire):
    """Straight to a place."""

    position: Sequence[float]
    """In the map, meters."""
    yaw: Optional[float] = None
    """About the map's z axis, counter-clockwise from x, radians; as it is when absent."""
    tolerance_m: Optional[float] = None
    """Distance that counts as there, meters; 0.15 when absent."""
    timeout_s: Optional[float] = None
    """Time for it; by the distance when absent."""
    type: Literal["goto"] = "goto"


@dataclass(frozen=True)
class HoldCommand(Wire):
    """Stop and stay."""

    type: Literal["hold"] = "hold"


@dataclass(frozen=True)
class LandCommand(Wire):
    """Down where it is, motors off."""

    type: Literal["land"] = "land"


@dataclass(frozen=True)
class StopCommand(Wire):
    """Motors off at once: it falls."""

    type: Literal["stop"] = "stop"


DroneCommand = Union[
    ArmCommand,
    DisarmCommand,
    TakeoffCommand,
    GotoCommand,
    HoldCommand,
    LandCommand,
    StopCommand,
]
"""What a drone is told."""


@dataclass(frozen=True)
class DroneCommandStatus(Wire):
    """How far a command has come."""

    id: int
    """Within the life of the service."""
    drone: int
    """System id of the drone."""
    state: str
    """`accepted`, `sent`, `executing`, `done`, `rejected`, `timed_out`, `superseded`."""
    detail: Optional[str] = None
    """Why it was rejected, in the drone's words."""


@dataclass(frozen=True)
class DroneEvent(Wire):
    """Something that happened to a drone."""

    seq: int
    """Rises by one with every event of any drone."""
    drone: int
    """System id of the drone."""
    t_ns: int
    """Nanoseconds since the Unix epoch."""
    kind: str
    """`link`, `feed`, `armed`, `mode`, `landed`, `rebooted`, `moved`, `text`, `command`, `alert`.
    """
    value: str
    """The new state, or what was said."""
    detail: Optional[str] = None
    """For people, or the id of the command."""


@dataclass(frozen=True)
class DroneLink(Wire):
    """How a drone is heard."""

    state: str
    """`seen`, `linked`, `stale`, `lost`."""
    silence_ms: float
    """Since the last heartbeat, milliseconds."""
    loss: float
    """Part of its messages that did not arrive."""
    round_trip_ms: Optional[float] = None
    """There and back, milliseconds."""


@dataclass(frozen=True)
class DronePlace(Wire):
    """A place of a drone in the map."""

    position: Sequence[float]
    """In the map, meters."""
    velocity: Sequence[float]
    """In the map, meters per second."""
    yaw: float
    """About the map's z axis, counter-clockwise from x, radians."""
    age_ms: Optional[float] = None
    """How long ago this was heard, milliseconds; absent for a target."""


@dataclass(frozen=True)
class DronePose(Posed):
    """The pose of a drone, from any source that knows it."""

    position: Sequence[float]
    """In the map, meters."""
    orientation: Sequence[float]
    """`map_from_body` (x forward, y left, z up); w, x, y, z."""
    age_ms: float
    """Since the image was taken, milliseconds."""
    position_sd: float
    """Standard deviation of each coordinate, meters."""
    angle_sd: float
    """Standard deviation of each angle, radians."""
    reset_counter: Optional[int] = None
    """Counts places that the source has given up for others: in flight, a place elsewhere that is
    not announced so is not believed.
    """


@dataclass(frozen=True)
class DronePoseAnswer(Wire):
    """What became of a pose."""

    sent: bool
    """Whether it was sent to the drone."""
    reason: Optional[str] = None
    """Why not."""


@dataclass(frozen=True)
class DroneState(Wire):
    """What a drone says of itself, and what it is told."""

    id: int
    """Its MAVLink system id."""
    t_ns: int
    """When this was so, nanoseconds since the Unix epoch."""
    autopilot: str
    """`ardupilot` or `px4`."""
    endpoint: str
    """UDP address."""
    link: DroneLink
    """How it is heard."""
    armed: bool
    """Motors may turn."""
    flying: bool
    """It may be in the air."""
    failsafe: bool
    """The autopilot acts on its own because something failed."""
    in_control: bool
    """It flies to the targets of the service."""
    feed: str
    """Whether its estimator follows the poses that it is sent: `idle`, `origin`, `feeding`,
    `ready`, `degraded`, `failed`.
    """
    mode: Optional[str] = None
    """`guided`, `land` or `other`; absent when it was not said."""
    battery: Optional[float] = None
    """Charge, 0 to 1."""
    sent_pose_age_ms: Optional[float] = None
    """Age of the latest pose that was sent to it, milliseconds."""
    estimate: Optional[DronePlace] = None
    """Where its estimator is, in the map."""
    target: Optional[DronePlace] = None
    """Where it is told to be, in the map."""


@dataclass(frozen=True)
class DroneTarget(Wire):
    """A place to fly to."""

    position: Sequence[float]
    """In the map, meters."""
    yaw: Optional[float] = None
    """About the map's z axis, counter-clockwise from x, radians; as it is when absent."""
    tolerance_m: Optional[float] = None
    """Distance that counts as there, meters; 0.15 when absent."""
    timeout_s: Optional[float] = None
    """Time for it; by the distance when absent."""


@dataclass(frozen=True)
class Effort(Wire):
    """The numbers that a preset sets."""

    max_image_size: int
    """Photos are made smaller until no side is longer."""
    max_features: int
    """Features of a photo at most."""
    similar_images: int
    """Photos that look alike, to each of which a photo is matched."""
    depth_map_pixels: int
    """Pixels of a depth map at most."""
    depth_map_sources: int
    """Other photos that a depth map is computed from at most."""
    octree_depth: int
    """Greatest depth of the octree that the surface is found in."""
    max_triangles: int
    """Triangles of the mesh at most."""
    texture_size: int
    """Longest side of the picture on the mesh."""


@dataclass(frozen=True)
class FenceBlock(Wire):
    """An upright block."""

    outline: Sequence[Sequence[float]]
    """Corners in order, in the map, meters."""
    floor: float
    """Lowest height, meters."""
    ceiling: float
    """Highest height, meters."""


@dataclass(frozen=True)
class Flight(Wire):
    """A flight whose plan has passed its check."""

    id: str
    """Within the life of the service."""
    map_id: str
    """The map that it is in."""
    state: str
    """`ready`, `running`, `paused`, `finished`, `aborted` (to land, or where it was by a command
    or by all-stop).
    """
    taking_off: bool
    """Whether drones are on their way up to the start."""
    clock_s: float
    """Time on the plan, seconds."""
    duration_s: float
    """Length of the plan, seconds."""
    drones: Sequence[FlightWay]
    """Who flies how."""
    events: Sequence[FlightNews]
    """What happened, in order; the last 200."""
    closest_m: Optional[float] = None
    """Nearest approach of two drones on the plan, heights counted half, meters."""
    clock_held_by: Optional[int] = None
    """The drone that the clock of all waits for."""


@dataclass(frozen=True)
class FlightDrone(Wire):
    """One drone of a flight."""

    id: int
    """MAVLink system id."""
    goals: Sequence[FlightGoal]
    """Where it goes, in order; the group goes to its next goals together. None stays."""
    start: Optional[FlightGoal] = None
    """Where its way starts; where it hovers when absent. One that stands beneath its start takes
    off when the flight starts.
    """


@dataclass(frozen=True)
class FlightGoal(Wire):
    """A place to fly to."""

    position: Sequence[float]
    """In the map, meters."""
    yaw: Optional[float] = None
    """About the map's z axis, counter-clockwise from x, radians; along the way when absent."""


@dataclass(frozen=True)
class FlightLeg(Wire):
    """One move of a drone, from rest to rest."""

    kind: str
    """`turn`, `horizontal`, `vertical`, `straight`, `wait`, `view`."""
    start_s: float
    """Seconds on the plan."""
    end_s: float
    """Seconds on the plan."""
    to: Sequence[float]
    """Where it ends, in the map, meters."""
    yaw: float
    """Yaw at its end, radians."""


@dataclass(frozen=True)
class FlightNews(Wire):
    """Something that happened in a flight."""

    t_ns: int
    """Nanoseconds since the Unix epoch."""
    kind: str
    """`state`, `leg`, `held`, `released`, `clock_held`, `clock_runs`, `taken_out`, `landed`,
    `replanned`, `no_way`, `frame` (one of the drone's frames was placed by its features).
    """
    drone: Optional[int] = None
    """Whom it concerns."""
    value: Optional[str] = None
    """The new state, the kind of the leg, the reason, or how far a frame corrected the drone.
    """


FlightStyle = Literal["horizontal_vertical", "straight"]
"""How goals are approached."""


@dataclass(frozen=True)
class FlightWay(Wire):
    """The way of one drone."""

    id: int
    """MAVLink system id."""
    start: Sequence[float]
    """Where it starts, in the map, meters."""
    legs: Sequence[FlightLeg]
    """Its legs in order."""
    taken_out: bool
    """Whether it is out of the flight and lands."""


@dataclass(frozen=True)
class FrameAnswer(Wire):
    """What a frame of a drone's camera says."""

    answer: LocalizeAnswer
    """The pose of the camera, or why there is none."""
    place: Optional[FramePlace] = None
    """The place of the drone, if there is one."""
    job_id: Optional[str] = None
    """The job by which the frame joins the map, if that was asked for."""


@dataclass(frozen=True)
class FrameHeader(Wire):
    """Header of a binary frame of kind 1."""

    stream_id: int
    """As opened."""
    seq: int
    """Made by the client, rising."""
    t_capture_ns: Optional[int] = None
    """When it was taken, nanoseconds of the client's clock."""
    encoding: Optional[ImageEncoding] = None
    """How the payload is coded."""
    width: Optional[int] = None
    """Pixels; needed for raw encodings."""
    height: Optional[int] = None
    """Pixels; needed for raw encodings."""
    prior: Optional[LocalizePrior] = None
    """What is known of the pose; not used by streams that track."""
    telemetry: Optional[FrameTelemetry] = None
    """What the drone reports of itself; used by streams that track."""


@dataclass(frozen=True)
class FramePlace(Posed):
    """The place of a drone by a frame of its camera."""

    position: Sequence[float]
    """Of the drone in the map, meters."""
    orientation: Sequence[float]
    """`map_from_body`; w, x, y, z."""
    sent: bool
    """Whether it was sent to the drone."""
    correction_m: Optional[float] = None
    """How far the drone's estimator is from it, meters."""
    goal_distance_m: Optional[float] = None
    """How far it is from the goal of the drone's flight, or from where it was told to be, meters.
    """
    reason: Optional[str] = None
    """Why not."""


@dataclass(frozen=True)
class FrameTelemetry(Wire):
    """What a drone reports of itself when a frame is taken; camera along the nose."""

    heading: Optional[float] = None
    """Radians clockwise from the compass's north. How north lies in the map is found out."""
    heading_sigma: Optional[float] = None
    """Standard deviation of the heading, radians; 0.035 when absent."""
    height: Optional[float] = None
    """Above any fixed level, m. How the level lies in the map is found out."""
    height_sigma: Optional[float] = None
    """Standard deviation of the height, m; 0.05 when absent."""
    velocity: Optional[Sequence[float]] = None
    """East, north and up, m/s; used once the heading is known."""
    velocity_sigma: Optional[float] = None
    """Standard deviation of the velocity per axis, m/s; 0.1 when absent."""


@dataclass(frozen=True)
class Geofence(Wire):
    """Where drones may fly in a map."""

    map_id: str
    """Of which map."""
    area: FenceBlock
    """Drones stay inside."""
    margin_m: float
    """Distance kept to all walls, floors and ceilings, meters."""
    keep_out: Sequence[FenceBlock] = ()
    """Drones stay outside."""


@dataclass(frozen=True)
class Health(Wire):
    """Whether the service can work."""

    status: str
    """`ok` or `unavailable`."""
    checks: Sequence[HealthCheck]
    """One entry per part."""


@dataclass(frozen=True)
class HealthCheck(Wire):
    """State of one part of the service."""

    name: str
    """`database`, `disk`, `worker`."""
    ok: bool
    """Whether it works."""
    detail: Optional[str] = None
    """What is wrong."""


@dataclass(frozen=True)
class HeightPrior(Wire):
    """Height of the camera above a fixed level."""

    height: float
    """Meters."""
    sigma: float
    """Standard deviation, meters."""


@dataclass(frozen=True)
class Image(Wire):
    """One photo."""

    id: str
    """Its id."""
    imageset_id: str
    """Where it belongs."""
    name: str
    """Unique in its set."""
    sha256: str
    """Of its bytes, hex."""
    size: int
    """Bytes."""
    format: str
    """`jpeg` or `png`."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    exif: Dict[str, Any]
    """What EXIF tells."""
    created: str
    """RFC 3339."""
    prior: Optional[Prior] = None
    """What is known of its pose."""
    capture_time_ns: Optional[int] = None
    """Nanoseconds since the Unix epoch."""


ImageEncoding = Literal["auto", "jpeg", "png", "gray8", "rgb8"]
"""How an image is coded."""


@dataclass(frozen=True)
class ImageSet(Wire):
    """Photos that belong together: one flight, one camera."""

    id: str
    """Its id."""
    name: str
    """For people."""
    num_images: int
    """Number of images."""
    created: str
    """RFC 3339."""
    camera_id: Optional[str] = None
    """Camera of all its images that have none of their own."""
    notes: Optional[str] = None
    """For people."""


@dataclass(frozen=True)
class Info(Wire):
    """What the service is and can do."""

    version: str
    """Of this software."""
    api: str
    """Of the API."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    capabilities: Capabilities
    """What it can do."""
    limits: Limits
    """What it refuses."""


@dataclass(frozen=True)
class Job(Wire):
    """A job."""

    id: str
    """Its id."""
    kind: JobKind
    """What it does."""
    state: JobState
    """Where it stands."""
    progress: JobProgress
    """How far it is."""
    stages: Sequence[JobStage]
    """In the order they ran."""
    attempt: int
    """Runs so far."""
    cancel_requested: bool
    """Whether someone asked it to stop."""
    warnings: Sequence[Warning]
    """What the user of its map should know."""
    request: CreateJob
    """What was asked for."""
    last_event: int
    """Number of its last event."""
    created: str
    """RFC 3339."""
    stage: Optional[str] = None
    """The running stage."""
    queue_position: Optional[int] = None
    """Jobs before it; with `queued`."""
    error: Optional[JobError] = None
    """Why it failed, or what its map lacks."""
    outputs: Optional[JobOutputs] = None
    """What it made."""
    started: Optional[str] = None
    """RFC 3339."""
    finished: Optional[str] = None
    """RFC 3339."""


@dataclass(frozen=True)
class JobError(Wire):
    """Why a job failed, or what its map lacks."""

    code: str
    """Stable."""
    detail: str
    """For people, with the figures."""
    hint: Optional[str] = None
    """What to do about it."""


@dataclass(frozen=True)
class JobEvent(Wire):
    """Something that happened to a job. Numbers rise by one without gaps."""

    seq: int
    """Number within the job, from 1."""
    time: str
    """RFC 3339."""
    type: str
    """`job.state`, `job.stage`, `job.progress`, `job.log`."""
    data: Any
    """`state`: `{state, error?, outputs?}`; `stage`, `progress`: `{stage, done, total, unit,
    fraction, eta_s}`; `log`: `{level, message}`.
    """


@dataclass(frozen=True)
class JobEvents(Wire):
    """Events after a number."""

    items: Sequence[JobEvent]
    """In order."""
    last: int
    """Ask again with `after` set to it."""


JobKind = Literal["reconstruct", "register_maps", "extend_map"]
"""What a job does."""


@dataclass(frozen=True)
class JobOption(Wire):
    """A number that a job may set in its `options`."""

    name: str
    """Its name in `options`."""
    description: str
    """What it means."""
    stage: StageGroup
    """The part of the way that it is for."""
    type: str
    """Always `integer`."""
    unit: str
    """What it counts."""
    minimum: int
    """Least value."""
    maximum: int
    """Greatest value."""
    defaults: PresetDefaults
    """Its value when the job does not set it."""


@dataclass(frozen=True)
class JobOptions(Wire):
    """Numbers that a job sets otherwise than its preset; `GET /v1/options` lists their ranges.
    """

    max_image_size: Optional[int] = None
    """Photos are made smaller until no side is longer."""
    max_features: Optional[int] = None
    """Features of a photo at most."""
    similar_images: Optional[int] = None
    """Photos that look alike, to each of which a photo is matched."""
    depth_map_pixels: Optional[int] = None
    """Pixels of a depth map at most."""
    depth_map_sources: Optional[int] = None
    """Other photos that a depth map is computed from at most."""
    octree_depth: Optional[int] = None
    """Greatest depth of the octree that the surface is found in."""
    max_triangles: Optional[int] = None
    """Triangles of the mesh at most."""
    texture_size: Optional[int] = None
    """Longest side of the picture on the mesh."""


@dataclass(frozen=True)
class JobOutputs(Wire):
    """What a job made."""

    map_id: str
    """The map."""
    version: int
    """Its version."""


@dataclass(frozen=True)
class JobProgress(Wire):
    """How far a job is."""

    fraction: float
    """Of the whole job, 0 to 1."""
    done: int
    """Finished units of the stage."""
    total: int
    """Units of the stage."""
    unit: str
    """What is counted."""
    eta_s: Optional[float] = None
    """Seconds to the end of the stage at the measured rate."""


@dataclass(frozen=True)
class JobStage(Wire):
    """One stage of a job."""

    name: str
    """Its name."""
    state: str
    """`running` or `done`."""
    started: str
    """RFC 3339."""
    done: int
    """Finished units."""
    total: int
    """Units."""
    unit: str
    """What is counted."""
    cached: int
    """Units that were found finished, from a run before."""
    ended: Optional[str] = None
    """RFC 3339."""


JobState = Literal["queued", "running", "succeeded", "partial", "failed", "cancelled"]
"""Where a job stands."""


@dataclass(frozen=True)
class KnownDistance(Wire):
    """The measured distance between the cameras of two images."""

    image_a: str
    """Image name."""
    image_b: str
    """Image name."""
    meters: float
    """Meters."""


@dataclass(frozen=True)
class Lease(Wire):
    """A lease: until it is over, nobody else commands its drones. When it is over, and nobody else
    takes them, they hold, and land half a minute later.
    """

    id: str
    """Within the life of the service."""
    holder: str
    """Name of the token that holds it."""
    drones: Sequence[int]
    """Which drones, by MAVLink system id."""
    ttl_ms: int
    """How long it lasts without being renewed, milliseconds."""
    left_ms: int
    """How long it still lasts, milliseconds."""


@dataclass(frozen=True)
class Limits(Wire):
    """Every limit of the service."""

    json_bytes: int
    """Bytes of a JSON body."""
    image_bytes: int
    """Bytes of one image."""
    upload_bytes: int
    """Bytes of one upload request."""
    archive_bytes: int
    """Bytes of an archive, packed."""
    archive_unpacked_bytes: int
    """Bytes of an archive, unpacked."""
    archive_entries: int
    """Entries of an archive."""
    archive_ratio: int
    """Unpacked over packed size, per entry and in total."""
    imageset_images: int
    """Images of one image set."""
    queued_jobs: int
    """Jobs waiting."""
    connections: int
    """Connections at once."""
    connections_per_address: int
    """Connections at once from one address."""
    header_timeout_s: int
    """Seconds to send the head of a request."""
    body_idle_timeout_s: int
    """Seconds a body may pause."""
    body_min_bytes_per_s: int
    """Bytes per second that a body must bring on average, beyond a first pause."""
    disk_reserve_bytes: int
    """Bytes of disk that stay free."""


@dataclass(frozen=True)
class Localization(Wire):
    """The answer to one image. A photo that cannot be placed is an answer, not an error."""

    status: LocalizeStatus
    """Whether there is a pose."""
    pose: Optional[CameraPose] = None
    """`map_from_camera`; with `ok` only."""
    covariance: Optional[Sequence[float]] = None
    """6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    """
    reason: Optional[str] = None
    """Stable code; with `not_found` and `ambiguous`."""
    rivals: Sequence[Rival] = ()
    """With `ambiguous`, best first."""
    num_features: Optional[int] = None
    """Features of the image."""
    num_correspondences: Optional[int] = None
    """2D-3D correspondences."""
    num_inliers: Optional[int] = None
    """Inliers of the pose."""
    inlier_ratio: Optional[float] = None
    """Inliers over correspondences."""
    reprojection_px: Optional[float] = None
    """Root mean square reprojection error, pixels."""
    method: Optional[LocalizeMethod] = None
    """`pnp` or `template`: which way answered."""
    render_score: Optional[RenderScore] = None
    """How well the map's mesh, drawn from the pose, agrees with the photo; if there is a mesh.
    """
    light: Optional[PhotoLight] = None
    """Light and sharpness of the photo; with `template`."""
    timings: Optional[LocalizeTimings] = None
    """Milliseconds per step."""


@dataclass(frozen=True)
class LocalizeAnswer(Wire):
    """Where an image was taken, or why that is unknown."""

    status: LocalizeStatus
    """Whether there is a pose."""
    frame: str
    """Always `map`: right-handed, z up."""
    map_id: str
    """The map."""
    map_version: int
    """Its version."""
    pose: Optional[CameraPose] = None
    """`map_from_camera`; with `ok` only."""
    covariance: Optional[Sequence[float]] = None
    """6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    """
    reason: Optional[str] = None
    """Stable code; with `not_found` and `ambiguous`."""
    rivals: Sequence[Rival] = ()
    """With `ambiguous`, best first."""
    num_features: Optional[int] = None
    """Features of the image."""
    num_correspondences: Optional[int] = None
    """2D-3D correspondences."""
    num_inliers: Optional[int] = None
    """Inliers of the pose."""
    inlier_ratio: Optional[float] = None
    """Inliers over correspondences."""
    reprojection_px: Optional[float] = None
    """Root mean square reprojection error, pixels."""
    method: Optional[LocalizeMethod] = None
    """`pnp` or `template`: which way answered."""
    render_score: Optional[RenderScore] = None
    """How well the map's mesh, drawn from the pose, agrees with the photo; if there is a mesh.
    """
    light: Optional[PhotoLight] = None
    """Light and sharpness of the photo; with `template`."""
    timings: Optional[LocalizeTimings] = None
    """Milliseconds per step."""


@dataclass(frozen=True)
class LocalizeManyAnswer(Wire):
    """Where in which of several maps an image was taken, or why that is unknown."""

    status: LocalizeStatus
    """Whether there is a pose."""
    frame: str
    """Always `map`: right-handed, z up."""
    map_id: str
    """The map."""
    map_version: int
    """Its version."""
    answers: Sequence[LocalizeAnswer]
    """Of each map, in the order asked."""
    pose: Optional[CameraPose] = None
    """`map_from_camera`; with `ok` only."""
    covariance: Optional[Sequence[float]] = None
    """6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    """
    reason: Optional[str] = None
    """Stable code; with `not_found` and `ambiguous`."""
    rivals: Sequence[Rival] = ()
    """With `ambiguous`, best first."""
    num_features: Optional[int] = None
    """Features of the image."""
    num_correspondences: Optional[int] = None
    """2D-3D correspondences."""
    num_inliers: Optional[int] = None
    """Inliers of the pose."""
    inlier_ratio: Optional[float] = None
    """Inliers over correspondences."""
    reprojection_px: Optional[float] = None
    """Root mean square reprojection error, pixels."""
    method: Optional[LocalizeMethod] = None
    """`pnp` or `template`: which way answered."""
    render_score: Optional[RenderScore] = None
    """How well the map's mesh, drawn from the pose, agrees with the photo; if there is a mesh.
    """
    light: Optional[PhotoLight] = None
    """Light and sharpness of the photo; with `template`."""
    timings: Optional[LocalizeTimings] = None
    """Milliseconds per step."""


LocalizeMethod = Literal["auto", "pnp", "template"]
"""How a photo is placed."""


@dataclass(frozen=True)
class LocalizePrior(Wire):
    """Where the camera may be."""

    position: Optional[PositionPrior] = None
    """Position in the map, meters."""
    yaw: Optional[YawPrior] = None
    """Rotation of the camera's forward axis about map z from map x, radians."""


LocalizeStatus = Literal["ok", "ambiguous", "not_found"]
"""Whether an image found its place."""


@dataclass(frozen=True)
class LocalizeTimings(Wire):
    """Milliseconds per step."""

    decode_ms: Optional[float] = None
    """Bytes to pixels."""
    features_ms: Optional[float] = None
    """Keypoints and descriptors."""
    match_ms: Optional[float] = None
    """Retrieval and matching."""
    solve_ms: Optional[float] = None
    """RANSAC and refinement."""
    total_ms: Optional[float] = None
    """From the arrival of the request to the answer."""


@dataclass(frozen=True)
class Map(Wire):
    """A place. Its versions never change."""

    id: str
    """Its id."""
    name: str
    """For people."""
    active_version: int
    """The version that answers when none is named."""
    latest_version: int
    """Newest version."""
    active: MapVersion
    """The active version."""
    created: str
    """RFC 3339."""


@dataclass(frozen=True)
class MapCamera(Wire):
    """A posed image of a map."""

    image: str
    """Image name."""
    pose: CameraPose
    """`map_from_camera`."""


@dataclass(frozen=True)
class MapCameras(Wire):
    """Posed images of a map."""

    map_id: str
    """The map."""
    version: int
    """Its version."""
    cameras: Sequence[Camera]
    """Intrinsics."""
    images: Sequence[MapCamera]
    """In the order of the map folder."""


@dataclass(frozen=True)
class MapFile(Wire):
    """One file of a map version."""

    path: str
    """Relative to the map folder."""
    sha256: str
    """Of its bytes, hex."""
    size: int
    """Bytes."""


@dataclass(frozen=True)
class MapVersion(Wire):
    """One immutable state of a map."""

    map_id: str
    """The map."""
    version: int
    """From 1."""
    info: Dict[str, Any]
    """The map folder's `map.json`: scale, gravity, origin, quality, cameras, bounds, ..."""
    files: Sequence[MapFile]
    """Files of the map folder."""
    created: str
    """RFC 3339."""
    job_id: Optional[str] = None
    """The job that made it."""
    parent_version: Optional[int] = None
    """The version it was made from."""


@dataclass(frozen=True)
class ModelReport(Wire):
    """What became of the poses of a model."""

    updated: int
    """Number of images of the set that have the pose and the camera of the model now."""
    unknown: Sequence[str]
    """Names in the model that no image of the set has."""
    missing: Sequence[str]
    """Names of images of the set that the model does not have."""


OriginRule = Literal["last_camera", "mean_cameras", "given"]
"""Which point is the origin of a map."""


@dataclass(frozen=True)
class PatchDrone(Wire):
    """Settings of a registered drone to be changed; what is absent stays, also its key."""

    name: Optional[str] = None
    """For people."""
    signing_key: Optional[str] = None
    """Its own signing key, 64 hex digits; never shown again."""
    vision: Optional[VisionMessage] = None
    """How it takes poses."""
    body_from_camera: Optional[CameraMount] = None
    """Its camera."""


@dataclass(frozen=True)
class PatchImageSet(Wire):
    """What to change of an image set."""

    name: Optional[str] = None
    """For people."""
    camera_id: Optional[str] = None
    """Camera of all its images that have none of their own."""
    notes: Optional[str] = None
    """For people."""


@dataclass(frozen=True)
class PatchMap(Wire):
    """What to change of a map."""

    name: Optional[str] = None
    """For people."""


@dataclass(frozen=True)
class PathLossModel(Wire):
    """How the strength of a signal falls: `RSSI(d) = at_1_m - 10 n log10(d)`."""

    at_1_m: float
    """Strength at 1 m, dBm."""
    exponent: float
    """Exponent n."""
    sigma_db: float
    """Standard deviation of a reading, dB."""


@dataclass(frozen=True)
class PhotoLight(Wire):
    """Light and sharpness of a photo: `photo = gain * map ^ gamma`, levels in 0..1."""

    gain: float
    """Factor at mid gray."""
    gamma: float
    """Exponent."""
    sharpness: float
    """Strength of the finest edges over that of edges at half the size; nearly 1 when sharp."""
    is_blurred: bool
    """Whether the photo lacks its finest details."""
    is_other_light: bool
    """Whether the light is another one than when the map was made."""


PoseSource = Literal["estimated", "given", "given_metric"]
"""Where the poses of photos come from."""


@dataclass(frozen=True)
class PositionPrior(Wire):
    """Position of the camera in a metric, z-up frame that all priors of a set share."""

    position: Sequence[float]
    """x, y, z in meters."""
    sigma: float
    """Standard deviation per axis, meters."""


Preset = Literal["fast", "balanced", "best"]
"""How much work a reconstruction may spend."""


@dataclass(frozen=True)
class PresetDefaults(Wire):
    """A value for each preset."""

    fast: int
    """With `fast`."""
    balanced: int
    """With `balanced`."""
    best: int
    """With `best`."""


@dataclass(frozen=True)
class PresetInfo(Wire):
    """What a preset means."""

    name: Preset
    """Its name in a job."""
    description: str
    """What it is for."""
    is_default: bool
    """Whether a job that names none has it."""
    last_stage: StageGroup
    """Where a job ends that names no stages."""
    values: Effort
    """The numbers that it sets."""


@dataclass(frozen=True)
class Prior(Wire):
    """What is known of an image before it is looked at."""

    attitude: Optional[AttitudePrior] = None
    """From the flight controller."""
    height: Optional[HeightPrior] = None
    """From a barometer or range finder."""
    position: Optional[PositionPrior] = None
    """From motion capture, RTK or a previous map."""
    pose: Optional[CameraPose] = None
    """The pose that another program found, in a frame that the priors of a set share. Only jobs
    with `poses: given` or `given_metric` look at it.
    """
    camera: Optional[Camera] = None
    """Intrinsics of this image, where they differ from those of its set; kept fixed."""
    time_s: Optional[float] = None
    """Seconds since an arbitrary start; orders the images of a flight."""


@dataclass(frozen=True)
class PriorsReport(Wire):
    """What became of the priors."""

    updated: int
    """Number of images that have one now."""
    unknown: Sequence[str]
    """Names that no image of the set has."""


@dataclass(frozen=True)
class Problem(Wire):
    """Why a request was not done."""

    type: str
    """A name for this kind of problem, as a URI."""
    title: str
    """A short name of the kind."""
    status: int
    """HTTP status."""
    code: str
    """Stable, for programs."""
    detail: str
    """What happened, for people."""
    hint: Optional[str] = None
    """What to do about it."""
    instance: Optional[str] = None
    """Path of the request."""


@dataclass(frozen=True)
class PutDrone(Wire):
    """A drone to be registered, or the settings of one to be replaced."""

    name: str
    """For people."""
    signing_key: Optional[str] = None
    """Its own signing key, 64 hex digits; never shown again. Without it the key of the service is
    its key.
    """
    vision: Optional[VisionMessage] = None
    """How it takes poses."""
    body_from_camera: Optional[CameraMount] = None
    """Its camera; in the middle, level and looking ahead when absent."""


@dataclass(frozen=True)
class PutDroneCamera(Wire):
    """A drone's camera to be pulled: motion JPEG over HTTP (`multipart/x-mixed-replace`)."""

    url: str
    """Plain `http`, without user and password; the host must be one that the service may pull from
    (`volery serve --camera-host`).
    """
    map_id: str
    """Where to look."""
    version: Optional[int] = None
    """The one that is active at the start when absent."""
    camera: Optional[Camera] = None
    """Intrinsics of the pictures; the map's own camera of their size when absent."""
    feed: Optional[bool] = None
    """Send the poses to the estimator of the drone. Needs a metric map."""


@dataclass(frozen=True)
class PutPriors(Wire):
    """Priors by image name."""

    priors: Dict[str, Prior]
    """By image name."""


@dataclass(frozen=True)
class Recording(Wire):
    """Everything that a drone's link sent and received from a start to an end."""

    id: str
    """For life."""
    drone: int
    """MAVLink system id."""
    t_ns: int
    """When it began, nanoseconds since the Unix epoch."""
    running: bool
    """Whether it goes on."""
    size: int
    """Bytes so far; the latest second may be missing."""


@dataclass(frozen=True)
class RegisterMaps(Wire):
    """Maps to join."""

    maps: Sequence[str]
    """Two maps or more; their active versions are joined in the frame of the first."""
    method: Optional[RegistrationMethod] = None
    """How they are brought together."""
    with_scale: Optional[bool] = None
    """Whether a map may be grown or shrunk; without, all maps must have one unit."""
    preset: Optional[Preset] = None
    """How much work is spent on the surface of the joined map."""
    options: Optional[JobOptions] = None
    """Numbers that differ from those of the preset."""
    stages: Sequence[StageGroup] = ()
    """How far to go: `sfm` joins the maps without their surfaces; where the preset ends when
    empty.
    """
    map_id: Optional[str] = None
    """The map that gets the result as a new version; a new map when absent."""
    map_name: Optional[str] = None
    """Name of a new map."""
    seed: Optional[int] = None
    """Seed of every random choice."""
    priority: Optional[int] = None
    """Higher first."""


@dataclass(frozen=True)
class Registration(Wire):
    """What `register_maps` may do."""

    method: Optional[RegistrationMethod] = None
    """How maps are brought together."""
    with_scale: Optional[bool] = None
    """Whether a map may be grown or shrunk; without, all maps must have one unit."""


RegistrationMethod = Literal["auto", "points", "surfaces"]
"""How maps are brought together."""


@dataclass(frozen=True)
class RenderRequest(Wire):
    """What a virtual camera is to draw."""

    pose: CameraPose
    """`map_from_camera`."""
    camera: Optional[Camera] = None
    """Intrinsics and size of the picture; the map's first camera when absent."""
    what: Optional[RenderWhat] = None
    """What the picture shows."""


@dataclass(frozen=True)
class RenderScore(Wire):
    """A drawn view against a photo: a second opinion on a pose."""

    agreement: float
    """Part of the view's patches that the photo shows within a pixel of where they should be, 0 to
    1; some 0.04 by chance.
    """
    correlation: float
    """Correlation of local contrasts, -1 to 1."""
    num_patches: int
    """Patches that were looked for."""
    seen: float
    """Part of the view that shows the map, 0 to 1."""


RenderWhat = Literal["color", "depth", "depth_f32"]
"""What a drawn picture shows."""


@dataclass(frozen=True)
class Rival(Wire):
    """A pose that is about as good as another."""

    pose: CameraPose
    """`map_from_camera`."""
    num_inliers: int
    """Inliers of the pose."""


Role = Literal["viewer", "mapper", "pilot", "admin"]
"""What a token may do; each role may do all that the ones before it may."""


@dataclass(frozen=True)
class HelloMessage(Wire):
    """First message of a connection."""

    version: str
    """Of the server's software."""
    conn_id: str
    """For logs."""
    ping_s: int
    """Seconds between pings."""
    max_frame_bytes: int
    """Bytes of the largest frame taken."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["hello"] = "hello"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class SubscribedMessage(Wire):
    """Events will follow."""

    topic: str
    """As asked."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["subscribed"] = "subscribed"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class UnsubscribedMessage(Wire):
    """Events will not follow."""

    topic: str
    """As asked."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["unsubscribed"] = "unsubscribed"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class EventMessage(Wire):
    """Something happened."""

    topic: str
    """As subscribed."""
    job_id: str
    """Which job."""
    event: JobEvent
    """The event, numbered within the job."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["event"] = "event"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class FlightStateMessage(Wire):
    """Something happened in a flight."""

    topic: str
    """As subscribed."""
    flight_id: str
    """Which flight."""
    event: FlightNews
    """The event."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["flight.state"] = "flight.state"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class DroneStateMessage(Wire):
    """What a drone says, ten times a second; of several that wait, the newest."""

    topic: str
    """As subscribed."""
    state: DroneState
    """As REST answers it."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["drone.state"] = "drone.state"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class CommandStateMessage(Wire):
    """A command went on."""

    topic: str
    """As subscribed."""
    command: DroneCommandStatus
    """As REST answers it."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["command.state"] = "command.state"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class AlertMessage(Wire):
    """Somebody should look."""

    topic: str
    """As subscribed."""
    alert: DroneAlert
    """At what."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["alert"] = "alert"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class ResyncMessage(Wire):
    """Events were lost: read them again by `after`."""

    topic: str
    """As subscribed."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["resync"] = "resync"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class StreamOpenedMessage(Wire):
    """Frames may be sent."""

    stream_id: int
    """For the headers of the frames."""
    map_id: str
    """The map."""
    map_version: int
    """Its version."""
    credit: int
    """Frames that may wait."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["stream.opened"] = "stream.opened"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class StreamClosedMessage(Wire):
    """No more frames."""

    stream_id: int
    """As opened."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["stream.closed"] = "stream.closed"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class FrameResultMessage(Wire):
    """The pose of a frame."""

    stream_id: int
    """As opened."""
    seq: int
    """Of the frame."""
    result: LocalizeAnswer
    """As REST answers it."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    t_capture_ns: Optional[int] = None
    """Of the frame."""
    type: Literal["frame.result"] = "frame.result"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class FrameTrackedMessage(Wire):
    """The pose of a frame of a stream that tracks."""

    stream_id: int
    """As opened."""
    seq: int
    """Of the frame."""
    map_id: str
    """The map."""
    map_version: int
    """Its version."""
    result: TrackedFrame
    """State, pose and latency."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    t_capture_ns: Optional[int] = None
    """Of the frame."""
    type: Literal["frame.tracked"] = "frame.tracked"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class PoseMessage(Wire):
    """What a frame of a drone's camera says about its place."""

    drone_id: str
    """Of the stream that the frame came by."""
    map_id: str
    """The map."""
    map_version: int
    """Its version."""
    frame_seq: int
    """Of the frame."""
    result: TrackedFrame
    """State, pose of the camera and latency; `age_ms` since the frame was taken."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["pose"] = "pose"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class FrameDroppedMessage(Wire):
    """A frame without an answer."""

    stream_id: int
    """As opened."""
    seq: int
    """Of the frame."""
    reason: str
    """`superseded`, `too_large`, `decode_error`, `overload`."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    detail: Optional[str] = None
    """For people."""
    type: Literal["frame.dropped"] = "frame.dropped"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class LeasedMessage(Wire):
    """Drones are leased: answer to `lease` and `lease.renew`."""

    lease: Lease
    """As REST answers it."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["leased"] = "leased"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class LeaseReleasedMessage(Wire):
    """A lease is over, as asked."""

    lease_id: str
    """Which one."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["lease.released"] = "lease.released"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class PongMessage(Wire):
    """Answer to `ping`."""

    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["pong"] = "pong"
    re: Optional[str] = None
    """`id` of the message it answers."""


@dataclass(frozen=True)
class ErrorMessage(Wire):
    """A message that could not be done."""

    code: str
    """Stable."""
    detail: str
    """For people."""
    t_ns: int
    """The server's time, nanoseconds since the Unix epoch."""
    type: Literal["error"] = "error"
    re: Optional[str] = None
    """`id` of the message it answers."""


ServerMessage = Union[
    HelloMessage,
    SubscribedMessage,
    UnsubscribedMessage,
    EventMessage,
    FlightStateMessage,
    DroneStateMessage,
    CommandStateMessage,
    AlertMessage,
    ResyncMessage,
    StreamOpenedMessage,
    StreamClosedMessage,
    FrameResultMessage,
    FrameTrackedMessage,
    PoseMessage,
    FrameDroppedMessage,
    LeasedMessage,
    LeaseReleasedMessage,
    PongMessage,
    ErrorMessage,
]
"""From the server."""


@dataclass(frozen=True)
class Sim3(Wire):
    """A similarity: `x_in_new = scale * rotation * x_in_map + translation`."""

    rotation: Sequence[float]
    """Unit quaternion w, x, y, z."""
    translation: Sequence[float]
    """Meters."""
    scale: float
    """Positive."""
    metric: Optional[bool] = None
    """Whether lengths are meters afterwards."""
    sigma_rel: Optional[float] = None
    """Standard deviation of `scale` relative to it, where something tells it."""


StageGroup = Literal["sfm", "dense", "mesh"]
"""Parts of the way from photos to a full environment map, in order; each needs those before it.
"""


@dataclass(frozen=True)
class StoredCamera(Wire):
    """A kept camera."""

    id: str
    """Its id."""
    name: str
    """For people."""
    camera: Camera
    """Intrinsics."""
    created: str
    """RFC 3339."""


StreamMode = Literal["latest", "all"]
"""What to do with frames that come faster than answers."""


@dataclass(frozen=True)
class StreamOpen(Wire):
    """A localization stream to open."""

    map_id: str
    """Where to look."""
    version: Optional[int] = None
    """The active one when absent; it stays the same for the life of the stream."""
    camera: Optional[Camera] = None
    """Intrinsics of all frames."""
    mode: Optional[StreamMode] = None
    """What to do with frames that come faster than answers."""
    track: Optional[bool] = None
    """Follow the camera from frame to frame: frames are answered with `frame.tracked`. All of them
    must be of one size and have rising capture times.
    """
    drone_id: Optional[str] = None
    """The drone whose camera this is; with `track`, its poses are the drone's."""
    feed: Optional[bool] = None
    """Send the poses to the estimator of the drone, whose MAVLink system id `drone_id` then is.
    Needs `track`, a metric map and the role `pilot`.
    """


@dataclass(frozen=True)
class Target(Wire):
    """The planned way of a drone to its target."""

    drone: int
    """MAVLink system id."""
    start: FlightGoal
    """Where it is."""
    legs: Sequence[FlightLeg]
    """Its legs in order."""
    duration_s: float
    """Time for it, seconds."""
    checks: Sequence[TargetCheck]
    """What it was checked against."""
    turn: Optional[float] = None
    """From its front to the direction of the target in the horizontal plane, counter-clockwise,
    radians; absent when the target is straight above or below.
    """
    closest_m: Optional[float] = None
    """Nearest approach to another drone in the air, heights counted half, meters."""
    flight_id: Optional[str] = None
    """The flight that it became, unless it was only planned."""


@dataclass(frozen=True)
class TargetCheck(Wire):
    """One check of a way."""

    rule: str
    """`map_metric`, `geofence`, `free_space`, `separation`, `limits`, `drone`."""
    state: str
    """`passed`, `failed`, or `unknown` where the map does not tell."""
    detail: Optional[str] = None
    """What is wrong, where and when."""


@dataclass(frozen=True)
class Token(Wire):
    """A token without its secret."""

    id: str
    """Its id."""
    name: str
    """Who or what it is for."""
    role: Role
    """What it may do."""
    created: str
    """RFC 3339."""
    expires: Optional[str] = None
    """RFC 3339."""


@dataclass(frozen=True)
class TrackLatency(Wire):
    """Milliseconds per step; they add up to `total_ms`."""

    recv_ms: float
    """From the arrival of the frame until work on it began, and back: all that is not below."""
    decode_ms: float
    """Bytes to pixels."""
    track_ms: float
    """Points followed, pose, filter."""
    features_ms: float
    """Keypoints and descriptors, where they were needed."""
    match_ms: float
    """Retrieval and matching, where they were needed."""
    solve_ms: float
    """Poses by recognized features, where they were needed."""
    total_ms: float
    """From the arrival of the frame to the answer."""


TrackSource = Literal["klt", "pnp", "fused"]
"""What a pose rests on most."""


TrackState = Literal["tracking", "relocalizing", "lost"]
"""Whether the camera's place is known."""


@dataclass(frozen=True)
class TrackedFrame(Wire):
    """The answer to one frame."""

    state: TrackState
    """Whether the place is known."""
    age_ms: float
    """Milliseconds since the frame arrived."""
    num_points: int
    """Points of the map that agree with the pose."""
    reset_counter: int
    """Counts places that were given up for others: what trusted the poses before must start anew.
    """
    latency: TrackLatency
    """Milliseconds per step."""
    pose: Optional[CameraPose] = None
    """`map_from_camera` of this very frame; with `tracking` only, and then always."""
    covariance: Optional[Sequence[float]] = None
    """6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    """
    source: Optional[TrackSource] = None
    """What the pose rests on."""
    reason: Optional[str] = None
    """Why there is no pose: `bad_frame`, `not_found`, `unconfirmed`, `contradicted`."""
    fault: Optional[str] = None
    """What is wrong with the frame, even if it has a pose: `frozen`, `out_of_order`, `wrong_size`,
    `no_contrast`, `dark`, `blurred`.
    """
    since_pose_ms: Optional[float] = None
    """Milliseconds from the last frame with a pose to this one, by their capture times."""
    inlier_ratio: Optional[float] = None
    """Over those that were looked for."""
    reprojection_px: Optional[float] = None
    """Root mean square reprojection error, pixels."""


@dataclass(frozen=True)
class Upload(Wire):
    """An archive on its way."""

    id: str
    """Its id."""
    imageset_id: str
    """The image set that its photos go into."""
    size: int
    """Bytes of the whole file."""
    sha256: str
    """SHA-256 of the whole file."""
    offset: int
    """Bytes that are safe on the disk: the next part begins there."""
    created: str
    """RFC 3339."""


@dataclass(frozen=True)
class UploadReport(Wire):
    """What became of an upload, file by file."""

    results: Sequence[UploadResult]
    """In the order sent."""
    stored: int
    """Number of files kept."""
    duplicates: int
    """Number of files the set had."""
    rejected: int
    """Number of files refused."""


@dataclass(frozen=True)
class UploadResult(Wire):
    """What became of one uploaded file."""

    name: str
    """As sent."""
    status: UploadStatus
    """What became of it."""
    image_id: Optional[str] = None
    """Of the stored or the equal image."""
    sha256: Optional[str] = None
    """Of the bytes, hex."""
    code: Optional[str] = None
    """Stable code of the rejection: `empty_file`, `not_an_image`, `truncated`, `too_large`,
    `name_taken`, `unsafe_name`, `archive_link`, `archive_ratio`, ...
    """
    detail: Optional[str] = None
    """For people."""
    warnings: Sequence[str] = ()
    """What is odd without being fatal."""


UploadStatus = Literal["stored", "duplicate", "rejected"]
"""What became of one uploaded file."""


VisionMessage = Literal["position_estimate", "odometry"]
"""Which MAVLink message carries poses to a drone's estimator."""


@dataclass(frozen=True)
class Warning(Wire):
    """Something that the user of a map should know."""

    code: str
    """Stable."""
    detail: str
    """For people, with the figures."""
    hint: Optional[str] = None
    """What to do about it."""


@dataclass(frozen=True)
class YawPrior(Wire):
    """A yaw in the map."""

    yaw: float
    """Radians, counter-clockwise seen from above."""
    sigma: float
    """Standard deviation, radians."""
