#!/usr/bin/env python3
"""What runs onboard, on one machine: two software vehicles, two `veilwing fly`, every link between them signed.

Flies the mission and leaves the logs in --out. A ground station (pymavlink) on both vehicles' second link gives the
vehicles their key (SETUP_SIGNING), and starts the mission, signed. Vehicle J's companion waits for its autopilot.

    signed_flight.py --programs target/debug --mission tests/flight/yard.toml --out logs --port 14560 --speed 3

Exits 0 if the mission is completed, 1 otherwise.
"""

import argparse
import math
import os
import pathlib
import secrets
import subprocess
import sys
import time
import tomllib

os.environ["MAVLINK20"] = "1"
from check import check, run  # noqa: E402
from pymavlink import mavutil  # noqa: E402

VEHICLE = """
[vehicle]
role = "{role}"
[autopilot]
link = "{autopilot}"
system_id = {system}
key_file = "autopilot.key"
tracks_pose = true
[transmitter]
kind = "leased"
simulated = true
[pair]
link = "{pair}"
peer_system_id = {peer}
key_file = "pair.key"
[log]
dir = "{out}"
"""


def home(mission, role):
    """Latitude, longitude, height of a vehicle's home; a plane tangent to the earth is good enough in a yard."""
    origin = mission["mission"]["origin"]
    east, north, up = mission["vehicles"][role]["home_enu_m"]
    lat = origin["lat_deg"] + north / 111_229.0
    lon = origin["lon_deg"] + east / (111_413.0 * math.cos(math.radians(lat)))
    return f"{lat:.7f},{lon:.7f},{origin['alt_amsl_m'] + up}"


def sign(station, key):
    """Gives both vehicles the key, and signs from then on."""
    left, end = {1, 2}, time.monotonic() + 20.0
    while left and time.monotonic() < end:
        message = station.recv_match(type="HEARTBEAT", blocking=True, timeout=0.2)
        if message is not None and message.get_srcSystem() in left:
            left.discard(message.get_srcSystem())
    check(not left, "both vehicles are heard")
    ticks = int((time.time() - 1_420_070_400) * 1e5)
    for system in (1, 2):
        station.mav.setup_signing_send(system, 1, key, ticks)
    station.setup_signing(key, sign_outgoing=True)


def start(arguments, running, station):
    """The four programs."""
    mission = tomllib.loads(pathlib.Path(arguments.mission).read_text())
    out = pathlib.Path(arguments.out).absolute()
    out.mkdir(parents=True, exist_ok=True)
    for name in ("pair", "autopilot"):
        key = out / f"{name}.key"
        key.touch(mode=0o600)
        key.write_text(secrets.token_hex(32) + "\n")
    port = arguments.port
    programs = pathlib.Path(arguments.programs)

    def launch(name, *command):
        log = (out / f"{name}.log").open("w")
        running[name] = subprocess.Popen([str(part) for part in command], stdout=log, stderr=log)

    listens, calls = (f"udpin:127.0.0.1:{port + 2}", f"udpin:127.0.0.1:{port + 3}"), "udpout:127.0.0.1:"
    for k, role in enumerate("ij"):
        launch(
            f"vehicle-{role}", programs / "veilwing-sitl", "vehicle", "--system-id", k + 1, "--speed", arguments.speed,
            "--link", listens[0] if role == "i" else f"{calls}{port + 3}", "--ground-station", f"udpout:127.0.0.1:{port}",
            "--home", home(mission, role),
        )
    sign(station, bytes.fromhex((out / "autopilot.key").read_text()))
    for k, role in enumerate("ij"):
        pair = f"udpin:127.0.0.1:{port + 1}" if role == "i" else f"udpout:127.0.0.1:{port + 1}"
        file = out / f"vehicle-{role}.toml"
        autopilot = f"{calls}{port + 2}" if role == "i" else listens[1]
        file.write_text(
            VEHICLE.format(role=role, autopilot=autopilot, system=k + 1, pair=pair, peer=2 - k, out=out)
        )
        launch(
            f"companion-{role}", programs / "veilwing", "fly", arguments.mission, "--vehicle", file,
            "--clock-rate", arguments.speed,
        )
    return out


def fly(arguments, running):
    """From MISSION_START to the end of both companions."""
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{arguments.port}", dialect="ardupilotmega")
    out = start(arguments, running, station)
    companions = [running["companion-i"], running["companion-j"]]
    ready, started, end = set(), False, time.monotonic() + 60.0 + 300.0 / arguments.speed
    while time.monotonic() < end and any(c.poll() is None for c in companions):
        message = station.recv_match(type=["STATUSTEXT", "COMMAND_ACK"], blocking=True, timeout=0.2)
        if message is None:
            continue
        if message.get_type() == "STATUSTEXT" and message.text.startswith("waiting: MISSION_START"):
            ready.add(message.get_srcSystem())
        if message.get_type() == "COMMAND_ACK" and message.command == 300 and message.result != 5:
            check(message.result == 0, "the start is accepted")
        if ready == {1, 2} and not started:
            started = True
            check(True, "both companions are heard over their vehicles' routers, and wait for the start alone")
            station.mav.command_long_send(1, 191, 300, 0, 0, 0, 0, 0, 0, 0, 0)
    ends = [c.poll() for c in companions]
    check(ends == [0, 0], f"both companions complete the mission (exit codes {ends})")
    for role in "ij":
        for link in ("pair", "autopilot"):
            check((out / f"{role}-{link}.signing").exists(), f"companion {role} has signed its {link} link")
    good, bad = station.mav.signing.goodsig_count, station.mav.signing.badsig_count
    check(good > 1000 and bad == 0, f"pymavlink finds {good} signatures right and {bad} wrong")


def main(arguments):
    running = {}
    try:
        fly(arguments, running)
    except BaseException:
        for name in running:
            sys.stdout.write(f"-- {name}\n" + (pathlib.Path(arguments.out) / f"{name}.log").read_text()[-3000:])
        raise
    finally:
        for process in running.values():
            process.terminate()
            process.wait()


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--programs", required=True, help="directory of veilwing and veilwing-sitl")
parser.add_argument("--mission", required=True, help="mission file")
parser.add_argument("--out", required=True, help="directory of the logs")
parser.add_argument("--port", type=int, default=14560, help="four UDP ports of this machine, from this one on")
parser.add_argument("--speed", type=float, default=3.0, help="simulated seconds per second")
ARGUMENTS = parser.parse_args()
run(lambda: main(ARGUMENTS), 90.0 + 300.0 / ARGUMENTS.speed)
