# Written by generate.py; changes here are lost.
"""Flights: plans of many drones, checked, flown, watched."""

from __future__ import annotations

import os
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence

from .. import types
from ..errors import Conflict, FlightAborted, TimedOut, VoleryError
from ..geometry import floats
from ..types import CreateFlight, FlightDrone, FlightGoal, FlightStyle, FlightWay
from .api import Api
from .concurrency import sleep
from .http import Http

#: Between two looks at a flight, seconds.
POLL_INTERVAL = 0.2
#: So long a flight may take to end after its drones have landed, seconds.
LAST_FLIGHT_ENDS = 5.0


class Flight:
    """A flight whose plan has passed its check."""

    def __init__(self, http: Http, info: types.Flight) -> None:
        self._api = Api(http)
        self.info = info
        """Plan, state and events when it was last looked at."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id} {self.info.state}, {self.info.duration_s:.1f} s>"

    @property
    def id(self) -> str:
        """Its id."""
        return self.info.id

    def refresh(self) -> Flight:
        """Looks at it."""
        self.info = self._api.get_flight(self.id)
        return self

    def start(self) -> Flight:
        """Takes off with those who stand beneath their starts, and flies when all are there.

        Drones whose last flight is just ending are waited for.
        """
        deadline = time.monotonic() + LAST_FLIGHT_ENDS
        while True:
            try:
                self.info = self._api.start_flight(self.id)
                return self
            except Conflict as error:
                if error.code != "drone_busy" or time.monotonic() > deadline:
                    raise
            sleep(POLL_INTERVAL)

    def pause(self) -> Flight:
        """Everybody waits in the air."""
        self.info = self._api.pause_flight(self.id)
        return self

    def resume(self) -> Flight:
        """Goes on after a pause."""
        self.info = self._api.resume_flight(self.id)
        return self

    def abort(self) -> Flight:
        """Everybody lands."""
        self.info = self._api.abort_flight(self.id)
        return self

    def wait(
        self, timeout: Optional[float] = None, *, check: Callable[[], None] = lambda: None
    ) -> Flight:
        """Waits until it is finished. One that ends otherwise, or loses a drone on the way, is a
        `FlightAborted`. `check` is called meanwhile, again and again."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            lost = [way.id for way in self.info.drones if way.taken_out]
            if self.info.state == "aborted":
                raise FlightAborted(f"the flight was aborted{_why(self.info)}", flight=self.info)
            if self.info.state == "finished":
                if lost:
                    raise FlightAborted(f"drones {lost} landed{_why(self.info)}", flight=self.info)
                return self
            if deadline is not None and time.monotonic() > deadline:
                raise TimedOut(f"the flight is still {self.info.state}")
            check()
            sleep(POLL_INTERVAL)
            self.refresh()

    def waypoints(self) -> Dict[int, Any]:
        """By drone, the corners of its way: n x 3 places in the map, meters."""
        return {way.id: corners(way) for way in self.info.drones}


def corners(way: FlightWay) -> List[Sequence[float]]:
    """Start and ends of the legs of a way."""
    return [way.start, *(leg.to for leg in way.legs)]


def _why(flight: types.Flight) -> str:
    reasons = [e for e in flight.events if e.kind in ("taken_out", "no_way") and e.value]
    told = ", ".join(f"drone {e.drone}: {e.value}" for e in reasons)
    return f" ({told})" if told else ""


def fitting_map(api: Api) -> str:
    """The map that the environment's `VOLERY_MAP` names, else the only metric one of a server."""
    named = os.environ.get("VOLERY_MAP")
    if named:
        return named
    maps = (api.list_maps(limit=1000)).items
    metric = [map.id for map in maps if map.active.info.get("scale", {}).get("metric")]
    if len(metric) != 1:
        detail = f"the server has {len(metric)} metric maps"
        raise VoleryError(detail, code="which_map", hint="say which: `map=...`, or VOLERY_MAP")
    return metric[0]


def plan_of(
    api: Api,
    map_id: str,
    goals: Mapping[Any, Any],
    *,
    height: float = 1.0,
    speed: Optional[float] = None,
    separation_m: Optional[float] = None,
    margin_m: Optional[float] = None,
    style: Optional[FlightStyle] = None,
    exchange_goals: bool = False,
) -> CreateFlight:
    """A flight to goals. Drones on the ground start `height` meters above where they stand."""
    drones = []
    for drone, wanted in goals.items():
        drone_id = drone if isinstance(drone, int) else drone.id
        drones.append(
            FlightDrone(
                id=drone_id,
                goals=[goal_of(goal) for goal in listed_goals(wanted)],
                start=_start_of(api, drone_id, height),
            )
        )
    return CreateFlight(
        map_id=map_id,
        drones=drones,
        style=style,
        exchange_goals=exchange_goals,
        separation_m=separation_m,
        margin_m=margin_m,
        speed=speed,
    )


def _start_of(api: Api, drone_id: int, height: float) -> Optional[FlightGoal]:
    state = api.drone_state(drone_id)
    if state.flying:
        # A drone that hovers settles where it is told to be, not where it happens to be now.
        told = state.target or state.estimate
        return None if told is None else FlightGoal(told.position, told.yaw)
    if state.estimate is None:
        detail = f"drone {drone_id} does not know where it is"
        raise VoleryError(detail, code="no_estimate", hint="feed it with poses first")
    x, y, z = state.estimate.position
    return FlightGoal((x, y, z + height))


def listed_goals(wanted: Any) -> List[Any]:
    """One goal or several, as a list."""
    if (
        isinstance(wanted, FlightGoal)
        or not hasattr(wanted[0], "__len__")
        and not isinstance(wanted[0], FlightGoal)
    ):
        return [wanted]
    return list(wanted)


def goal_of(goal: Any) -> FlightGoal:
    """`(x, y, z)` or `(x, y, z, yaw)` as a goal."""
    if isinstance(goal, FlightGoal):
        return goal
    numbers = floats(goal)
    if len(numbers) not in (3, 4):
        raise ValueError(f"a goal is x, y, z or x, y, z, yaw, not {numbers}")
    return FlightGoal(numbers[:3], numbers[3] if len(numbers) == 4 else None)
