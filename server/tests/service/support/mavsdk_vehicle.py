"""A multicopter whose link is MAVSDK's: its server plugins answer commands and tell its state.

It is where it flies, believes to be where it is told (VISION_POSITION_ESTIMATE), and flies to
SET_POSITION_TARGET_LOCAL_NED in PX4's offboard mode. Its true state goes to the standard output as
JSON lines: meters and radians, local frame with z down.

    mavsdk_vehicle.py --server 127.0.0.1:14550
"""

import argparse
import json
import math
import socket
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action_server.action_server import (
    ActionServer,
    AllowableFlightModes,
    FlightMode,
)
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import (
    MavlinkDirectServer,
    MavlinkMessage,
)
from mavsdk.plugins.telemetry_server import telemetry_server as telemetry
from pymavlink.dialects.v20 import ardupilotmega as mav

SYSTEM_ID = 1
TICK = 0.02
SPEED, DESCENT = 0.8, 0.4
# Part of the way to a pose that the belief comes over.
GAIN = 0.3
PX4, QUADROTOR = 12, 2
# ESTIMATOR_STATUS: attitude, velocities, and positions are good.
ESTIMATOR_FLAGS = 0x3F
HEARTBEAT = 0


class Vehicle:
    """Where it is, where it believes to be, and what it is told."""

    def __init__(self):
        self.pos, self.vel = [0.0] * 3, [0.0] * 3
        self.belief, self.fed_at = None, None
        self.yaw, self.target = 0.0, None
        self.mode, self.armed = FlightMode.HOLD, False
        self.lock = threading.Lock()

    def see(self, message):
        """A pose."""
        fields = json.loads(message.fields_json)
        seen = [float(fields[axis]) for axis in "xyz"]
        with self.lock:
            old = self.belief or seen
            self.belief = [b + GAIN * (s - b) for b, s in zip(old, seen)]
            self.fed_at = time.monotonic()

    def steer(self, message):
        """A setpoint."""
        fields = json.loads(message.fields_json)
        with self.lock:
            self.target = [float(fields[axis]) for axis in "xyz"], float(fields["yaw"])

    def is_fed(self):
        return self.fed_at is not None and time.monotonic() - self.fed_at < 0.5

    def step(self, dt):
        """One step of the flight. Returns whether it has just come down."""
        with self.lock:
            want = [0.0] * 3
            if self.armed and self.mode == FlightMode.OFFBOARD and self.target and self.is_fed():
                place, self.yaw = self.target
                want = [1.5 * (p - b) for p, b in zip(place, self.belief)]
                length = math.hypot(*want)
                want = [w * min(1.0, SPEED / max(length, 1e-9)) for w in want]
            elif self.armed and self.mode == FlightMode.LAND:
                want = [0.0, 0.0, DESCENT]
            self.vel = [v + (w - v) * dt / 0.2 for v, w in zip(self.vel, want)]
            step = [v * dt for v in self.vel]
            self.pos = [p + s for p, s in zip(self.pos, step)]
            if self.belief:
                self.belief = [b + s for b, s in zip(self.belief, step)]
            if self.pos[2] < 0:
                return False
            self.pos[2], self.vel = 0.0, [0.0] * 3
            return self.armed and self.mode == FlightMode.LAND


class Relay:
    """Between MAVSDK and the socket."""

    def __init__(self, server, sdk):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(server)
        self.sdk, self.lock = sdk, threading.Lock()
        self.reader = mav.MAVLink(None)
        self.reader.robust_parsing = True
        threading.Thread(target=self.receive, daemon=True).start()

    def receive(self):
        while True:
            try:
                self.sdk.pass_received_raw_bytes(self.socket.recv(2048))
            except ConnectionRefusedError:
                time.sleep(TICK)

    def send(self, data):
        """MAVSDK cannot be told which autopilot it is, while the modes it knows are PX4's."""
        with self.lock:
            for message in self.reader.parse_buffer(data) or []:
                frame = message.get_msgbuf()
                if message.get_msgId() == HEARTBEAT:
                    message.autopilot, message.type = PX4, QUADROTOR
                    header = message.get_header()
                    writer = mav.MAVLink(None, header.srcSystem, header.srcComponent)
                    writer.seq = header.seq
                    frame = message.pack(writer)
                try:
                    self.socket.send(frame)
                except ConnectionRefusedError:
                    pass


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--server", required=True)
    parser.add_argument("--report-hz", type=float, default=20.0)
    options = parser.parse_args()
    host, port = options.server.rsplit(":", 1)

    configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
    configuration.system_id = SYSTEM_ID
    sdk = Mavsdk(configuration)
    relay = Relay((host, int(port)), sdk)
    sdk.subscribe_raw_bytes_to_be_sent(relay.send)
    sdk.add_any_connection("raw://")
    component = sdk.server_component()
    vehicle = Vehicle()
    direct = MavlinkDirectServer(component)
    direct.subscribe_message("VISION_POSITION_ESTIMATE", lambda m, _: vehicle.see(m))
    direct.subscribe_message("SET_POSITION_TARGET_LOCAL_NED", lambda m, _: vehicle.steer(m))
    action, state = ActionServer(component), telemetry.TelemetryServer(component)
    # Its clock starts here, too.
    start = time.monotonic()

    def arm(_result, change, _data):
        vehicle.armed = change.arm

    def change_mode(_result, mode, _data):
        vehicle.mode = mode

    action.subscribe_arm_disarm(arm)
    action.subscribe_flight_mode_change(change_mode)
    action.set_armable(True, True)
    action.set_disarmable(True, True)
    action.set_allowable_flight_modes(AllowableFlightModes(*[True] * 7))

    last = next_report = time.monotonic()
    ticks = int((last - start) / TICK)
    while True:
        ticks += 1
        time.sleep(max(0.0, start + ticks * TICK - time.monotonic()))
        now = time.monotonic()
        if vehicle.step(min(now - last, 0.1)):
            vehicle.armed = False
            action.set_armed_state(False)
        last = now
        with vehicle.lock:
            pos, vel, yaw = list(vehicle.pos), list(vehicle.vel), vehicle.yaw
            belief = vehicle.belief or pos
            is_fed = vehicle.is_fed()
        if ticks % 3 == 0:
            # First what carries a stamp of ours, which is the older one.
            state.publish_attitude(
                telemetry.EulerAngle(0.0, 0.0, math.degrees(yaw), int((now - start) * 1e6)),
                telemetry.AngularVelocityBody(0.0, 0.0, 0.0),
            )
            state.publish_position_velocity_ned(
                telemetry.PositionVelocityNed(
                    telemetry.PositionNed(*belief), telemetry.VelocityNed(*vel)
                )
            )
        if ticks % 25 == 0:
            landed = telemetry.LandedState.IN_AIR if pos[2] < -0.1 else telemetry.LandedState.ON_GROUND
            state.publish_extended_sys_state(telemetry.VtolState.UNDEFINED, landed)
            fields = {name: 0 for name in ("time_usec", "vel_ratio", "pos_horiz_ratio",
                                           "pos_vert_ratio", "mag_ratio", "hagl_ratio", "tas_ratio",
                                           "pos_horiz_accuracy", "pos_vert_accuracy")}
            fields["flags"] = ESTIMATOR_FLAGS if is_fed else 0
            direct.send_message(
                MavlinkMessage("ESTIMATOR_STATUS", SYSTEM_ID, 1, 0, 0, json.dumps(fields))
            )
        if now >= next_report:
            next_report += 1 / options.report_hz
            print(json.dumps({"sysid": SYSTEM_ID, "pos": pos, "rpy": [0.0, 0.0, yaw]}), flush=True)


if __name__ == "__main__":
    main()
