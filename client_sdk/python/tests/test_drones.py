"""Drones do what a script says, and hold when it is gone."""

from __future__ import annotations

import numpy as np
import pytest
from support.server import Field, until

from volery import Client, Map, errors

#: Speed of a drone that holds, meters per second.
STILL = 0.15


def test_a_drone_does_what_it_is_told(client: Client, hall: Map, field: Field) -> None:
    drone = client.drone(field.ids[0])
    x, y, _ = field.place(drone.id)
    drone.takeoff(0.8).wait()
    assert abs(field.place(drone.id)[2] - 0.8) < 0.2
    drone.goto(np.array([x + 0.8, y, 1.0]), yaw=0.5).wait()
    # The tolerance of a target, and the noise of the estimate.
    assert np.linalg.norm(np.subtract(field.place(drone.id), (x + 0.8, y, 1.0))) < 0.25
    state = next(iter(drone.states()))
    assert state.flying and state.estimate is not None and state.target is not None
    drone.goto((x, y, 0.8), timeout_s=20)
    overtaken = drone.goto((x, y, 1.0))
    drone.hold()
    with pytest.raises(errors.CommandFailed) as failed:
        overtaken.wait()
    assert failed.value.code == "superseded"
    drone.land().wait()
    with pytest.raises(errors.Conflict) as refused:
        drone.goto((x, y, 1.0)).wait()
    assert refused.value.code and refused.value.detail


def test_what_makes_no_sense_is_refused(client: Client, hall: Map, field: Field) -> None:
    with client.lease(field.ids) as group:
        with pytest.raises(errors.VoleryError) as apart:
            group.plan({1: (0, 0, 1), 2: (0.1, 0, 1)})
        assert apart.value.code and "1" in apart.value.detail
        with pytest.raises(ValueError, match="a goal is"):
            group.plan({1: (0, 0)})
        with pytest.raises(errors.Conflict, match="leas"), client.lease(field.ids[:1]):
            pass
    with pytest.raises(errors.LeaseLost):
        group.fly({1: (0, 0, 1)})


def test_leaving_the_block_holds(client: Client, hall: Map, field: Field) -> None:
    one = field.ids[0]
    x, y, _ = field.place(one)
    with pytest.raises(ZeroDivisionError), client.lease([one], map=hall) as group:
        group.fly({one: (x, y, 1.0)})
        # Inside the fence, wherever an earlier flight has left it.
        group.plan({one: (x - np.copysign(2.5, x), y, 1.0)}).start()
        until(lambda: field.speed(one) > 0.4, "it flies")
        raise ZeroDivisionError
    left = field.clock()
    until(lambda: field.speed(one) < STILL, "it holds")
    # It brakes from 1 m/s.
    assert field.truth[one]["t"] - left < 1.0
    assert field.truth[one]["flying"]


def test_a_lease_is_kept_alive(client: Client, hall: Map, field: Field) -> None:
    one = field.ids[0]
    x, y, _ = field.place(one)
    with client.lease([one], ttl=0.4) as group:
        # Many times as long as the lease lasts.
        flight = group.fly({one: [(x, y, 1.0), (x + 0.5, y, 1.0)]})
        assert flight.info.state == "finished"
        assert np.linalg.norm(np.subtract(field.place(one), (x + 0.5, y, 1.0))) < 0.25
        assert flight.waypoints()[one][-1] == pytest.approx((x + 0.5, y, 1.0), abs=0.05)
        group.land()
