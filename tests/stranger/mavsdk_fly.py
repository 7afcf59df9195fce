#!/usr/bin/env python3
"""MAVSDK flies a software vehicle with either firmware face.

Reads version, health, home, battery and every parameter, finds no mission, fence or rally point, arms, takes off, goes
to a place on the globe, flies to two points in offboard mode, stops, and lands. The vehicle must be there already:

    veilwing-sitl vehicle --link udpout:127.0.0.1:14550 --firmware px4 --speed 3
    mavsdk_fly.py --port 14550 --speed 3

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import asyncio
import math

from check import check, run
from mavsdk.asyncio import Autopilot, ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.offboard import PositionNedYaw
from mavsdk.plugins.param import ParamError
from mavsdk.plugins.telemetry import FlightMode, LandedState

HEIGHT_M = 8.0
METRES_A_DEGREE = 111_229.0  # of latitude, at 50 degrees north


class Pilot:
    """One vehicle as MAVSDK sees it."""

    def __init__(self, system, speed):
        self.speed = speed
        self.telemetry = TelemetryAsync(system)
        self.action = ActionAsync(system)
        self.offboard = OffboardAsync(system)
        self.info = InfoAsync(system)
        self.param = ParamAsync(system)
        self.missions = MissionRawAsync(system)

    async def until(self, stream, what, accept=lambda value: True, simulated_s=30.0):
        """The first value of a telemetry stream that is accepted."""

        async def first():
            async for value in stream:
                if accept(value):
                    return value
            return None

        try:
            value = await asyncio.wait_for(first(), max(simulated_s / self.speed, 20.0))
        except asyncio.TimeoutError:
            value = None
        check(value is not None, what)
        return value

    async def fly_to(self, name, north_m, east_m, down_m):
        """A point of offboard mode, reached in the vehicle's own telemetry."""
        await self.offboard.set_position_ned(PositionNedYaw(north_m, east_m, down_m, 0.0))

        def near(m):
            at = (m.position.north_m, m.position.east_m, m.position.down_m)
            return math.dist(at, (north_m, east_m, down_m)) < 0.4

        reached = f"{name}: offboard reaches ({north_m:.0f}, {east_m:.0f}, {down_m:.0f}) m NED"
        await self.until(self.telemetry.subscribe_position_velocity_ned(), reached, near)


async def refused(call, kind):
    """The result with which MAVSDK says that a call was refused, or None."""
    try:
        await call
    except kind as error:
        return str(error)
    return None


async def read(pilot, system, px4):
    """Everything that MAVSDK's users look at first."""
    version = await pilot.info.get_version()
    told = f"{version.flight_sw_major}.{version.flight_sw_minor}.{version.flight_sw_patch}"
    check(version.flight_sw_major == (1 if px4 else 4), f"tells its version, {told}")
    check(1 in await system.component_ids(), "has an autopilot")
    t = pilot.telemetry
    await pilot.until(t.subscribe_health_all_ok(), "is healthy: sensors, position, home, armable", lambda ok: ok)
    home = await pilot.until(t.subscribe_home(), "tells its home")
    origin = await t.get_gps_global_origin()
    check(abs(origin.latitude_deg - home.latitude_deg) < 1e-6, "its local origin is where it stands")
    battery = await pilot.until(t.subscribe_battery(), "tells its battery")
    check(battery.remaining_percent > 90, f"which is full ({battery.remaining_percent:.0f} %)")
    await t.set_rate_position(10.0)

    every = await pilot.param.get_all_params()
    count = len(every.int_params) + len(every.float_params)
    check(count >= 10, f"gives all of its {count} parameters")
    name = "MAV_SYS_ID" if px4 else "SYSID_THISMAV"
    check(await pilot.param.get_param_int(name) == await system.get_system_id(), f"{name} is its system id")
    name = "MPC_XY_VEL_MAX" if px4 else "GUID_TIMEOUT"
    await pilot.param.set_param_float(name, 7.5)
    check(await pilot.param.get_param_float(name) == 7.5, f"{name} is set and read back")
    check(await refused(pilot.param.get_param_float("NO_SUCH"), ParamError), "has no parameter NO_SUCH")
    for kind in ("mission", "geofence", "rallypoints"):
        check(await getattr(pilot.missions, f"download_{kind}")() == [], f"has no {kind}")
    return home


async def take_off(pilot):
    """To HEIGHT_M, in the order of MAVSDK's own examples."""
    await pilot.action.set_takeoff_altitude(HEIGHT_M)
    await pilot.action.arm()
    await pilot.until(pilot.telemetry.subscribe_armed(), "is armed", lambda armed: armed)
    await pilot.action.takeoff()
    up = await pilot.until(
        pilot.telemetry.subscribe_position(),
        f"is {HEIGHT_M:.0f} m up",
        lambda p: abs(p.relative_altitude_m - HEIGHT_M) < 0.4,
    )
    await pilot.until(pilot.telemetry.subscribe_in_air(), "says that it is in the air", lambda flies: flies)
    return up


async def fly(pilot, px4):
    """By place on the globe, then by offboard points, then stopped."""
    t = pilot.telemetry
    start = await take_off(pilot)
    goal_deg = start.latitude_deg + 20.0 / METRES_A_DEGREE
    await pilot.action.goto_location(goal_deg, start.longitude_deg, start.absolute_altitude_m + 2.0, 0.0)

    def there(p):
        north_m = (p.latitude_deg - goal_deg) * METRES_A_DEGREE
        return abs(north_m) < 0.4 and abs(p.relative_altitude_m - HEIGHT_M - 2.0) < 0.5

    await pilot.until(t.subscribe_position(), "goes to a place 20 m north and 2 m higher", there)
    mode = FlightMode.HOLD if px4 else FlightMode.OFFBOARD
    await pilot.until(t.subscribe_flight_mode(), f"in {mode.name}", lambda m: m == mode)

    await pilot.offboard.set_position_ned(PositionNedYaw(20.0, 0.0, -10.0, 0.0))
    # PX4 wants more than a second of its own time of setpoints before it trusts them.
    await asyncio.sleep(1.5 / min(pilot.speed, 1.5))
    await pilot.offboard.start()
    await pilot.until(t.subscribe_flight_mode(), "takes offboard mode", lambda m: m == FlightMode.OFFBOARD)
    await pilot.fly_to("east", 20.0, 12.0, -10.0)
    await pilot.fly_to("home", 0.0, 0.0, -6.0)
    await pilot.offboard.stop()
    left = lambda m: m != FlightMode.OFFBOARD  # noqa: E731
    await pilot.until(t.subscribe_flight_mode(), "leaves offboard mode when told to stop", left)


async def land(pilot):
    """Down, and disarmed by the landing."""
    await pilot.action.land()
    t = pilot.telemetry
    down = lambda state: state == LandedState.ON_GROUND  # noqa: E731
    await pilot.until(t.subscribe_landed_state(), "is on the ground", down, 60.0)
    await pilot.until(t.subscribe_armed(), "is disarmed by its landing", lambda armed: not armed, 20.0)


async def main(arguments):
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{arguments.port}")
        print(f"MAVSDK {await mavsdk.version()}", flush=True)
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        check(system is not None, "finds the vehicle")
        pilot = Pilot(system, arguments.speed)
        # Known from the first HEARTBEAT on.
        await pilot.until(pilot.telemetry.subscribe_flight_mode(), "tells its mode")
        kind = await system.autopilot_type()
        check(kind in (Autopilot.PX4, Autopilot.ARDUPILOT), f"knows its firmware, {kind!r}")
        px4 = kind == Autopilot.PX4
        try:
            await read(pilot, system, px4)
            await fly(pilot, px4)
            await land(pilot)
        except MavsdkError as error:
            check(False, f"MAVSDK's call is refused: {type(error).__name__} {error}")
        check(await refused(pilot.action.set_current_speed(3.0), ActionError), "refuses what it cannot do")


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--port", type=int, default=14550, help="the vehicle sends to this UDP port of this machine")
parser.add_argument("--speed", type=float, default=1.0, help="the vehicle's --speed, to scale time-outs")
ARGUMENTS = parser.parse_args()
run(lambda: asyncio.run(main(ARGUMENTS)), 120.0)
