#!/usr/bin/env python3
"""MAVProxy flies a software vehicle with either firmware face, typed to as an operator types.

Connects, reads every parameter, changes mode, arms, takes off, flies to a place on the globe with `guided`, lands.
What the vehicle does is read from the telemetry that MAVProxy passes on to its --out port, by pymavlink. The vehicle
must be there already:

    veilwing-sitl vehicle --link udpout:127.0.0.1:14550 --firmware px4 --speed 5
    mavproxy_fly.py --port 14550 --speed 5

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import math

from check import check, run
from mavproxy_driver import MavProxy

METRES_A_DEGREE = 111_229.0  # of latitude, at 50 degrees north
ARMED = 128


def distance_m(a, b):
    """Horizontal distance of two GLOBAL_POSITION_INT."""
    north_m = (a.lat - b[0]) * 1e-7 * METRES_A_DEGREE
    east_m = (a.lon - b[1]) * 1e-7 * METRES_A_DEGREE * math.cos(math.radians(a.lat * 1e-7))
    return math.hypot(north_m, east_m)


def fly(proxy, px4):
    """Up, 25 m north-east, down."""
    proxy.wait("HEARTBEAT", lambda m: m.get_srcComponent() == 1, 20, "MAVProxy passes the autopilot's heartbeat on")
    proxy.said("Received [0-9]+ parameters", 30, "MAVProxy has every parameter")
    name = "MPC_XY_VEL_MAX" if px4 else "GUID_TIMEOUT"
    proxy.type(f"param set {name} 7")
    proxy.wait("PARAM_VALUE", lambda m: (m.param_id, m.param_value) == (name, 7.0), 10, f"sets {name}")
    start = proxy.wait("GLOBAL_POSITION_INT", lambda m: True, 10, "tells where it is")

    if not px4:
        proxy.type("mode GUIDED")
        proxy.wait("HEARTBEAT", lambda m: m.custom_mode == 4, 10, "is in GUIDED")
        proxy.said("Mode GUIDED", 10, "MAVProxy shows the mode")
    proxy.type("arm throttle")
    proxy.wait("HEARTBEAT", lambda m: m.base_mode & ARMED and m.get_srcComponent() == 1, 10, "is armed")
    proxy.said("^ARMED", 10, "MAVProxy shows that it is armed")
    # PX4 reads the height of a take-off as above the sea, ArduCopter as above home.
    proxy.type(f"takeoff {start.alt / 1000.0 + 10.0:.1f}" if px4 else "takeoff 10")
    proxy.wait("GLOBAL_POSITION_INT", lambda m: abs(m.relative_alt - 10_000) < 400, 30, "is ten metres up")
    if px4:
        # Take-off over, it holds: custom_mode 4 (auto), 3 (hold).
        proxy.wait("HEARTBEAT", lambda m: m.custom_mode == 4 << 16 | 3 << 24, 10, "holds after its take-off")

    goal = (start.lat + round(15 / METRES_A_DEGREE * 1e7), start.lon + round(20 / 71_400 * 1e7))
    # PX4 takes the height as above the sea whatever the frame says, so the frame had better say so too.
    proxy.type("set flytoframe AMSL" if px4 else "set flytoframe AboveHome")
    height_m = start.alt / 1000.0 + 12.0 if px4 else 12.0
    proxy.type(f"guided {goal[0] * 1e-7:.7f} {goal[1] * 1e-7:.7f} {height_m:.1f}")
    proxy.said("COMMAND_INT|DO_REPOSITION", 10, "MAVProxy hears that the point is taken")
    near = lambda m: distance_m(m, goal) < 0.5 and abs(m.relative_alt - 12_000) < 500  # noqa: E731
    proxy.wait("GLOBAL_POSITION_INT", near, 40, "is 15 m north and 20 m east of its start, 12 m up")
    mode = 4 << 16 | 3 << 24 if px4 else 4
    proxy.wait("HEARTBEAT", lambda m: m.custom_mode == mode, 10, "in " + ("HOLD" if px4 else "GUIDED"))


def land(proxy, px4):
    """Down, and disarmed by the landing."""
    # MAVProxy knows PX4's modes by name and cannot set them.
    proxy.type("long NAV_LAND" if px4 else "mode LAND")
    proxy.wait("EXTENDED_SYS_STATE", lambda m: m.landed_state == 1, 60, "is on the ground")
    disarmed = lambda m: m.get_srcComponent() == 1 and not m.base_mode & ARMED  # noqa: E731
    proxy.wait("HEARTBEAT", disarmed, 20, "is disarmed by its landing")
    proxy.said("^DISARMED", 10, "MAVProxy shows that it is disarmed")


def main(arguments):
    with MavProxy(f"udpin:127.0.0.1:{arguments.port}", arguments.port + 1, arguments.speed) as proxy:
        beat = proxy.wait("HEARTBEAT", lambda m: m.get_srcComponent() == 1, 30, "hears the vehicle through MAVProxy")
        px4 = beat.autopilot == 12
        fly(proxy, px4)
        land(proxy, px4)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--port", type=int, default=14550, help="the vehicle sends to this UDP port; MAVProxy to the next")
parser.add_argument("--speed", type=float, default=1.0, help="the vehicle's --speed, to scale time-outs")
ARGUMENTS = parser.parse_args()
run(lambda: main(ARGUMENTS), 180.0)
