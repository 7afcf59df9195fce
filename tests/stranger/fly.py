#!/usr/bin/env python3
"""A stranger's flight: pymavlink, which knows nothing of veilwing, flies a software vehicle.

Connects, reads heartbeat, parameters and position, arms, takes off, flies to two points by
SET_POSITION_TARGET_LOCAL_NED, tilts by SET_ATTITUDE_TARGET, lands, and checks each step against
what the MAVLink documents say. Starts nothing: the vehicle must be there already, for example

    veilwing-sitl vehicle --link udpout:127.0.0.1:14550 --firmware px4
    fly.py --link udpin:127.0.0.1:14550

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import math
import os
import struct
import time

os.environ["MAVLINK20"] = "1"
from check import CheckFailed, check, run  # noqa: E402
from pymavlink import mavutil  # noqa: E402

MAV = mavutil.mavlink
# Ignore everything but position (and, in the second, but position and velocity).
POSITION_ONLY = 0b110111111000
RATES_AND_THRUST_IGNORED = 0b01000111


class Stranger:
    """One connection, and what has been heard on it."""

    def __init__(self, link, speed):
        self.link = mavutil.mavlink_connection(link, source_system=255, source_component=190)
        self.speed = speed
        self.texts = []
        self.target = None

    def wait(self, simulated_s, kinds, accept=lambda m: True, each=None, system=None):
        """The first message of these kinds that is accepted; `each` runs about fifty times a second."""
        end = time.monotonic() + max(simulated_s / self.speed, 0.5)
        next_call = 0.0
        while time.monotonic() < end:
            if each and time.monotonic() >= next_call:
                next_call = time.monotonic() + 0.02 / self.speed
                each()
            message = self.link.recv_match(blocking=True, timeout=0.005 if each else 0.1)
            if message is None:
                continue
            # What its definitions do not have, pymavlink gives a number for a name and no sender.
            unknown = message.get_type().startswith("UNKNOWN_")
            if not unknown and message.get_srcSystem() != (system or self.link.target_system):
                continue
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
                print(f"     vehicle says: {message.text}", flush=True)
            if message.get_type() in kinds and accept(message):
                return message
        return None

    def command(self, command, *params):
        """Sends a COMMAND_LONG and returns the MAV_RESULT that answers it."""
        values = list(params) + [0] * (7 - len(params))
        self.link.mav.command_long_send(self.link.target_system, 1, command, 0, *values)
        ack = self.wait(5, ["COMMAND_ACK"], lambda m: m.command == command)
        check(ack is not None, f"command {command} is answered")
        check(
            (ack.target_system, ack.target_component) == (255, 190),
            f"the answer to {command} is addressed to its sender",
        )
        return ack.result

    def heartbeat(self, accept=lambda m: True, seconds=5, each=None):
        """The next HEARTBEAT of the autopilot itself."""
        return self.wait(seconds, ["HEARTBEAT"], lambda m: m.get_srcComponent() == 1 and accept(m), each)

    def send_position(self, north, east, down):
        """One SET_POSITION_TARGET_LOCAL_NED."""
        self.link.mav.set_position_target_local_ned_send(
            0, self.link.target_system, 1, MAV.MAV_FRAME_LOCAL_NED, POSITION_ONLY,
            north, east, down, 0, 0, 0, 0, 0, 0, 0, 0,
        )

    def send_attitude(self, roll, pitch, yaw):
        """One SET_ATTITUDE_TARGET from Euler angles, by the aerospace sequence (yaw, pitch, roll)."""
        cr, sr = math.cos(roll / 2), math.sin(roll / 2)
        cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        quaternion = [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
        self.link.mav.set_attitude_target_send(
            0, self.link.target_system, 1, RATES_AND_THRUST_IGNORED, quaternion, 0, 0, 0, 0.5
        )

    def fly_to(self, name, north, east, down, attitude=None, seconds=40):
        """Streams a target until the vehicle is there, in its own telemetry and on the globe."""
        def stream():
            self.send_position(north, east, down)
            if attitude:
                self.send_attitude(*attitude)

        def near(m):
            return math.dist((m.x, m.y, m.z), (north, east, down)) < 0.3

        there = self.wait(seconds, ["LOCAL_POSITION_NED"], near, stream)
        check(there is not None, f"{name}: reaches ({north:.1f}, {east:.1f}, {down:.1f}) m NED")
        return stream


def read_parameters(s):
    """The whole list; returns {name: (value, type)} of the autopilot."""
    s.link.mav.param_request_list_send(s.link.target_system, 1)
    values, count = {}, None
    while count is None or len(values) < count:
        m = s.wait(5, ["PARAM_VALUE"], lambda m: m.get_srcComponent() == 1)
        check_quietly(m is not None, f"parameters stopped at {len(values)} of {count}")
        values[m.param_id] = (m.param_value, m.param_type)
        count = m.param_count
    check(len(values) == count, f"reads all {count} parameters")
    return values


def check_quietly(condition, message):
    """A check inside a loop: only its failure is worth a line."""
    if not condition:
        raise CheckFailed(message)


def integer(value, bytewise):
    """An integer parameter from PARAM_VALUE's float."""
    return struct.unpack("<i", struct.pack("<f", value))[0] if bytewise else int(value)


def connect(s):
    """Heartbeat, version, parameters, position. Returns whether this is PX4."""
    first = s.link.wait_heartbeat(timeout=10)
    check(first is not None, "hears a heartbeat")
    s.link.target_system, s.link.target_component = first.get_srcSystem(), 1
    # The vehicle learns its client's address from a frame.
    s.link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, MAV.MAV_STATE_ACTIVE)
    beat = s.heartbeat()
    check(beat is not None, "hears the autopilot's heartbeat")
    px4 = beat.autopilot == MAV.MAV_AUTOPILOT_PX4
    check(px4 or beat.autopilot == MAV.MAV_AUTOPILOT_ARDUPILOTMEGA, "the firmware is PX4 or ArduPilot")
    check(not beat.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED, "is disarmed")
    radio = s.wait(5, ["HEARTBEAT"], lambda m: m.get_srcComponent() == 68)
    check(radio is not None, "a payload radio is aboard")

    check(s.command(MAV.MAV_CMD_REQUEST_MESSAGE, MAV.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == 0, "gives its version")
    check(s.command(31013) == MAV.MAV_RESULT_UNSUPPORTED, "refuses a command that it does not have")
    parameters = read_parameters(s)
    name, kind = ("MAV_SYS_ID", MAV.MAV_PARAM_TYPE_INT32) if px4 else ("SYSID_THISMAV", None)
    value = integer(parameters[name][0], bytewise=px4)
    check(value == s.link.target_system, f"{name} = {value} is the system id that it speaks with")
    check(kind is None or parameters[name][1] == kind, f"{name} has its type")

    real = "MPC_XY_VEL_MAX" if px4 else "GUID_TIMEOUT"
    s.link.mav.param_set_send(s.link.target_system, 1, real.encode(), 8.0, MAV.MAV_PARAM_TYPE_REAL32)
    echo = s.wait(5, ["PARAM_VALUE"], lambda m: m.param_id == real)
    check(echo is not None and echo.param_value == 8.0, f"{real} is set and echoed")

    position = s.wait(5, ["LOCAL_POSITION_NED"])
    globe = s.wait(5, ["GLOBAL_POSITION_INT"])
    check(position is not None and globe is not None, "tells its position, local and global")
    check(abs(position.z) < 0.1 and abs(globe.relative_alt) < 100, "stands on the ground")
    return px4


def set_mode(s, px4, each=None):
    """The companion's mode, confirmed by HEARTBEAT."""
    main = 6 if px4 else 4
    custom = main << 16 if px4 else main
    check(s.command(MAV.MAV_CMD_DO_SET_MODE, 1, main) == 0, "takes the mode")
    check(s.heartbeat(lambda m: m.custom_mode == custom, each=each) is not None, "HEARTBEAT shows the mode")


def arm_until_ready(s, each=None):
    """Arms as soon as the vehicle is ready."""
    for _ in range(10):
        if s.command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0:
            break
        s.wait(1, ["SYS_STATUS"], lambda m: False, each)
    armed = s.heartbeat(lambda m: m.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED, each=each)
    check(armed is not None, "is armed")


def take_off(s, px4):
    """To ten metres, in the firmware's own order."""
    if px4:
        def stream():
            s.send_position(0, 0, -10)

        check(s.command(MAV.MAV_CMD_DO_SET_MODE, 1, 6) == 0, "OFFBOARD is acknowledged while disarmed")
        refused = s.command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        check(refused == MAV.MAV_RESULT_TEMPORARILY_REJECTED, "arming without a stream is refused")
        # More than a second of it, at any speed of the simulation.
        s.wait(3, [], each=stream)
        set_mode(s, px4, stream)
        s.wait(1, [], each=stream)
        arm_until_ready(s, stream)
        s.fly_to("take-off", 0, 0, -10)
    else:
        early = s.command(MAV.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
        check(early == MAV.MAV_RESULT_FAILED, "take-off before GUIDED and arming is refused")
        set_mode(s, px4)
        arm_until_ready(s)
        check(s.command(MAV.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == 0, "takes off")
        up = s.wait(30, ["LOCAL_POSITION_NED"], lambda m: abs(m.z + 10) < 0.3)
        check(up is not None, "reaches ten metres")
        s.wait(2, [])
    flying = s.wait(5, ["EXTENDED_SYS_STATE"], lambda m: m.landed_state == MAV.MAV_LANDED_STATE_IN_AIR,
                    each=lambda: s.send_position(0, 0, -10))
    check(flying is not None, "says that it is in the air")


def fly(s):
    """Two points, so that a swapped or turned axis shows; then a tilt."""
    start = s.wait(5, ["GLOBAL_POSITION_INT"], each=lambda: s.send_position(0, 0, -10))
    stream = s.fly_to("north", 20, 0, -12)
    globe = s.wait(5, ["GLOBAL_POSITION_INT"], each=stream)
    # A degree of latitude is 111.2 km here, and the origin is where it took off.
    north = (globe.lat - start.lat) * 1e-7 * 111_200
    check(abs(north - 20) < 0.7 and abs(globe.lon - start.lon) < 100, f"positive x is north ({north:.2f} m)")
    check(abs(globe.relative_alt - 12_000) < 500, "negative z is up")

    stream = s.fly_to("east", 0, 15, -12)
    globe = s.wait(5, ["GLOBAL_POSITION_INT"], each=stream)
    east = (globe.lon - start.lon) * 1e-7 * 111_320 * math.cos(math.radians(globe.lat * 1e-7))
    check(abs(east - 15) < 0.7, f"positive y is east ({east:.2f} m)")

    roll, pitch, yaw = math.radians(35), math.radians(-20), math.radians(90)
    stream = s.fly_to("tilt", 0, 15, -12, (roll, pitch, yaw))
    s.wait(4, [], each=stream)
    attitude = s.wait(5, ["ATTITUDE_QUATERNION"], each=stream)
    check(attitude is not None, "tells its attitude")
    told = euler(attitude)
    error = max(abs(a - b) for a, b in zip(told, (roll, pitch, yaw)))
    shown = ", ".join(f"{math.degrees(a):.2f}" for a in told)
    check(math.degrees(error) < 1.5, f"ATTITUDE_QUATERNION shows roll, pitch, yaw = {shown} deg")
    still = s.wait(5, ["LOCAL_POSITION_NED"], each=stream)
    off = math.dist((still.x, still.y, still.z), (0, 15, -12))
    check(off < 0.2, f"and it stays where it is ({off:.3f} m)")


def euler(m):
    """Roll, pitch, yaw of a quaternion (w, x, y, z)."""
    w, x, y, z = m.q1, m.q2, m.q3, m.q4
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def lose_the_stream(s, px4):
    """PX4 falls back to Hold a second after the last setpoint, and says so."""
    if not px4:
        return
    held = s.heartbeat(lambda m: m.custom_mode == (4 << 16 | 3 << 24), seconds=5)
    check(held is not None, "without a stream it holds by itself")
    check(any("Offboard" in text for text in s.texts), "and says why")


def land(s):
    """Down, and disarmed by the landing."""
    check(s.command(MAV.MAV_CMD_NAV_LAND) == 0, "takes the order to land")
    down = s.wait(60, ["EXTENDED_SYS_STATE"], lambda m: m.landed_state == MAV.MAV_LANDED_STATE_ON_GROUND)
    check(down is not None, "is on the ground")
    disarmed = s.heartbeat(lambda m: not m.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED, seconds=20)
    check(disarmed is not None, "is disarmed by its landing")


def main(arguments):
    s = Stranger(arguments.link, arguments.speed)
    px4 = connect(s)
    take_off(s, px4)
    fly(s)
    lose_the_stream(s, px4)
    land(s)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--link", default="udpin:127.0.0.1:14550", help="as pymavlink writes addresses")
    parser.add_argument("--speed", type=float, default=1.0, help="the vehicle's --speed, to scale time-outs")
    ARGUMENTS = parser.parse_args()
    run(lambda: main(ARGUMENTS), 60.0 + 400.0 / ARGUMENTS.speed)
