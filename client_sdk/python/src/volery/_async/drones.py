"""Drones: states, poses, commands."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, AsyncIterator, Optional

from .. import types
from ..errors import CommandFailed, TimedOut
from ..geometry import floats, position_and_orientation
from ..types import (
    ArmCommand,
    DisarmCommand,
    DroneCommand,
    DroneCommandStatus,
    DronePose,
    DronePoseAnswer,
    DroneState,
    DroneStateMessage,
    GotoCommand,
    HoldCommand,
    LandCommand,
    PoseMessage,
    StopCommand,
    TakeoffCommand,
)
from .api import AsyncApi
from .concurrency import sleep
from .http import AsyncHttp
from .socket import topic_messages

if TYPE_CHECKING:
    from ..geometry import Vector

#: Between two looks at a command, seconds.
POLL_INTERVAL = 0.1


class AsyncDrone:
    """A drone, by its MAVLink system id.

    Places are in the map (z up, meters), yaw is about z, counter-clockwise from x, radians.
    Commands return as soon as the server has taken them: `.wait()` waits until they are done.
    """

    def __init__(self, http: AsyncHttp, info: types.Drone) -> None:
        self._http = http
        self._api = AsyncApi(http)
        self.info = info
        """Its settings, and its state when it was last looked at."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id} {self.info.name or ''}>"

    @property
    def id(self) -> int:
        """MAVLink system id."""
        return self.info.id

    async def state(self) -> DroneState:
        """What it says of itself, and what it is told."""
        return await self._api.drone_state(self.id)

    async def states(self) -> AsyncIterator[DroneState]:
        """Its state, ten times a second; a slow reader misses some."""
        async for message in topic_messages(self._http, f"drone:{self.id}"):
            if isinstance(message, DroneStateMessage):
                yield message.state

    async def poses(self) -> AsyncIterator[PoseMessage]:
        """What its camera says of its place, frame by frame.

        `pose.result.pose` is `map_from_camera`, `None` while the place is not known;
        `pose.result.pose.matrix` is 4 x 4.
        """
        async for message in topic_messages(self._http, f"pose:{self.id}"):
            if isinstance(message, PoseMessage):
                yield message

    async def arm(self) -> AsyncCommand:
        """Motors on."""
        return await self.command(ArmCommand())

    async def disarm(self) -> AsyncCommand:
        """Motors off, on the ground."""
        return await self.command(DisarmCommand())

    async def takeoff(self, height: float = 1.0) -> AsyncCommand:
        """Motors on if they are not, up, and hover `height` meters above where it stands."""
        return await self.command(TakeoffCommand(height))

    async def goto(
        self,
        position: Vector,
        yaw: Optional[float] = None,
        *,
        tolerance_m: Optional[float] = None,
        timeout_s: Optional[float] = None,
    ) -> AsyncCommand:
        """Straight to a place; nothing on the way is looked at. `lease().fly` plans ways."""
        return await self.command(GotoCommand(floats(position), yaw, tolerance_m, timeout_s))

    async def hold(self) -> AsyncCommand:
        """Stop and stay."""
        return await self.command(HoldCommand())

    async def land(self) -> AsyncCommand:
        """Down where it is, motors off."""
        return await self.command(LandCommand())

    async def stop(self) -> AsyncCommand:
        """Motors off at once: it falls."""
        return await self.command(StopCommand())

    async def command(self, command: DroneCommand) -> AsyncCommand:
        """Tells it something. It is sent once: a command that is late must not come at all."""
        return AsyncCommand(self._http, await self._api.command_drone(self.id, command))

    async def send_pose(
        self,
        map_from_body: Any,
        *,
        age_ms: float = 0.0,
        position_sd: float = 0.02,
        angle_sd: float = 0.02,
    ) -> DronePoseAnswer:
        """Tells its estimator where it is, from a tracker of your own.

        * `map_from_body`: 4 x 4; body: x forward, y left, z up.
        * `age_ms`: since it was measured, milliseconds.
        * `position_sd`, `angle_sd`: standard deviations, meters and radians.
        """
        position, orientation = position_and_orientation(map_from_body)
        pose = DronePose(position, orientation, age_ms, position_sd, angle_sd)
        return await self._api.drone_pose(self.id, pose)


class AsyncCommand:
    """What a drone was told, and how far it is."""

    def __init__(self, http: AsyncHttp, status: DroneCommandStatus) -> None:
        self._api = AsyncApi(http)
        self.status = status
        """How far it was when it was last looked at."""

    async def wait(self, timeout: Optional[float] = None) -> DroneCommandStatus:
        """Waits until it is done. One that is rejected, takes too long, or gives way to a newer
        one is a `CommandFailed`."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            status = self.status
            if status.state == "done":
                return status
            if status.state in ("rejected", "timed_out", "superseded"):
                detail = f"drone {status.drone}: {status.detail or status.state.replace('_', ' ')}"
                raise CommandFailed(detail, code=status.state, status=status)
            if deadline is not None and time.monotonic() > deadline:
                raise TimedOut(f"drone {status.drone}: the command is still {status.state}")
            await sleep(POLL_INTERVAL)
            self.status = await self._api.drone_command(status.drone, status.id)
