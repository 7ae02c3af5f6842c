# Written by generate.py; changes here are lost.
"""Drones that are held by a script, and hold when it is gone."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any, List, Mapping, Optional, Sequence, Type

from .. import types
from ..errors import CannotConnect, LeaseLost, ServerRefused
from ..types import CreateLease, DroneState, HoldCommand, LandCommand
from .api import Api
from .concurrency import Repeater
from .drones import Drone
from .flights import Flight, fitting_map, plan_of
from .http import Http

#: How long a lease lasts without being renewed, seconds: drones hold within a second.
DEFAULT_TTL = 0.8
#: Renewals within that time.
RENEWALS = 4


class Lease:
    """A group of drones that nobody else commands, from `client.lease([...])`.

    The lease is renewed in the background. Leaving the `with` block holds the drones, and so does
    the end of the script, however it ends.
    """

    def __init__(
        self, http: Http, drones: Sequence[int], map_id: Optional[str], ttl: float
    ) -> None:
        self._http = http
        self._api = Api(http)
        self._map_id = map_id
        self._ttl_ms = round(ttl * 1000)
        self._lease: Optional[types.Lease] = None
        self._renewal: Optional[Repeater] = None
        self._renewed = 0.0
        self.ids: Sequence[int] = list(drones)
        """MAVLink system ids."""

    def __enter__(self) -> Lease:
        request = CreateLease(drones=self.ids, ttl_ms=self._ttl_ms)
        self._lease = self._api.create_lease(request)
        self._renewed = time.monotonic()
        self._renewal = Repeater(self._renew, self._ttl_ms / 1000 / RENEWALS)
        self._end_left_flights()
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        if self._renewal is not None:
            self._renewal.close()
        lease, self._lease = self._lease, None
        try:
            if lease is not None:
                self._api.delete_lease(lease.id)
        except (CannotConnect, ServerRefused):
            # It runs out by itself; an error of the block is more to the point.
            if error is None:
                raise

    def _end_left_flights(self) -> None:
        """Ends flights that an earlier script left behind and whose drones all stand on the ground:
        they would keep its drones busy."""
        for flight in self._api.list_flights():
            drones = [way.id for way in flight.drones]
            is_over = flight.state in ("finished", "aborted")
            if is_over or not set(drones) & set(self.ids):
                continue
            states = [self._api.drone_state(drone) for drone in drones]
            if not any(state.flying for state in states):
                self._api.abort_flight(flight.id)

    def _renew(self) -> None:
        if self._lease is not None:
            self._lease = self._api.renew_lease(self._lease.id)
            self._renewed = time.monotonic()

    def check(self) -> None:
        """Raises `LeaseLost` if the server has not been reached in time."""
        if self._lease is None or self._renewal is None:
            raise LeaseLost("a lease is used inside of its `with` block")
        silence = time.monotonic() - self._renewed
        if self._renewal.error is not None or silence > self._ttl_ms / 1000:
            cause = self._renewal.error
            detail = f"the lease was not renewed for {silence:.1f} s: {cause or 'no answer'}"
            raise LeaseLost(detail) from cause

    def drones(self) -> List[Drone]:
        """Its drones."""
        return [Drone(self._http, self._api.get_drone(drone)) for drone in self.ids]

    def states(self) -> List[DroneState]:
        """What its drones say."""
        return [self._api.drone_state(drone) for drone in self.ids]

    def plan(self, goals: Mapping[Any, Any], **options: Any) -> Flight:
        """Plans a flight and checks the plan; see `fly` for goals and options."""
        self.check()
        map_id = self._map_id or fitting_map(self._api)
        request = plan_of(self._api, map_id, goals, **options)
        return Flight(self._http, self._api.create_flight(request))

    def fly(
        self, goals: Mapping[Any, Any], *, timeout: Optional[float] = None, **options: Any
    ) -> Flight:
        """Flies to goals and returns when all are there.

        * `goals`: by drone, `(x, y, z)` or `(x, y, z, yaw)` in the map, meters and radians, or a
          list of them; the group goes to its next goals together.
        * `height`: drones on the ground first take off to this height above where they stand.
        * `speed`: largest level speed, meters per second.
        * `separation_m`: smallest distance between drones; heights count half.
        * `style`: `horizontal_vertical` (the default) or `straight`.
        * `exchange_goals`: drones may exchange their goals for shorter ways.

        A plan that breaks a rule is refused before anybody moves: `Invalid` or `Conflict` with the
        drones, the time and the place.
        """
        flight = self.plan(goals, **options)
        flight.start()
        return flight.wait(timeout, check=self.check)

    def land(self, timeout: Optional[float] = None) -> None:
        """Lands all and waits until they are down."""
        self.check()
        commands = [drone.command(LandCommand()) for drone in self.drones()]
        for command in commands:
            command.wait(timeout)

    def hold(self) -> None:
        """Everybody stops and stays."""
        self.check()
        for drone in self.drones():
            drone.command(HoldCommand())
