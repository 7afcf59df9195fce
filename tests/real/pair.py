#!/usr/bin/env python3
"""A pair of real autopilots flown by two `veilwing fly`, with independent transmitters, and what goes wrong on the way.

Environment: PX4 and ARDUPILOT (built source trees, as far as they are flown), VEILWING (the program), RUN (a folder for flights),
MAVLINK20=1; run.sh sets all but the first two. The mission is flown about PX4's usual place, whatever its own origin.
usage: pair.py NAME [--i FRAME] [--j FRAME] [options] [--do 'TRIGGER=>ACTION[&ACTION]']...
A TRIGGER is ROLE@REGEX[+SECONDS] (a line of that companion's log) or t+SECONDS (from MISSION_START); an ACTION one of
  kill ROLE   term ROLE   stop ROLE SECONDS   restart ROLE            the companion
  cut ROLE SECONDS   delay ROLE S [JITTER]   loss ROLE P              its link to the autopilot (--gate)
  pilot ROLE position|hold|land|home   push ROLE   cmd ROLE COMMAND [P1..]        the pilot; an order to the companion
  gps ROLE   param ROLE NAME VALUE   radiokill ROLE   burst ROLE N    the vehicle
Leaves RUN/NAME: i/, j/ (companion logs, truth.csv), tx-i.log, tx-j.log, gcs.log, mission.toml, setup.json, events.json, end.json;
then score.py RUN/NAME.
"""

import argparse
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib

from autopilots import FRAMES, GATE_CONTROL, HERE, ONBOARD, PAIR, PAYLOAD, home_of
from ground import ROLES, Ground
from movers import NOISE_M, Movers

LNDMC = "LNDMC_Z_VEL_MAX"


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("name")
    p.add_argument("--i", choices=FRAMES, default="px4")
    p.add_argument("--j", choices=FRAMES, default="px4")
    p.add_argument("--mission", required=True)
    p.add_argument("--altitude", type=float, nargs=2, help="the mission's band, m, in place of its own")
    p.add_argument("--slot", type=float, help="its slot_s, in place of its own")
    p.add_argument("--settle", type=float, help="its settle_s, in place of its own")
    p.add_argument("--optimise", help="in place of its own")
    p.add_argument("--mode", choices=("turning", "moving"), help="served through its turns, or in motion, twice round")
    p.add_argument("--moves", nargs="*", default=[], help="users and eavesdroppers that walk or drive: NAME=walks|drives")
    p.add_argument("--area", type=float, help="half the side of the mission's area, m, in place of its own")
    p.add_argument("--limit", nargs="*", default=[], help="keys of both [vehicles] tables in place of the frame's: NAME=VALUE")
    p.add_argument("--origin", type=float, nargs=3, default=[47.397742, 8.545594, 488.0])
    p.add_argument("--home-i", type=float, nargs=3, default=[-15.0, -10.0, 0.0])
    p.add_argument("--home-j", type=float, nargs=3, default=[-10.0, -60.0, 0.0])
    p.add_argument("--yaw", type=float, default=0.0, help="of both vehicles at the start, ENU, deg (omni_hil: NED)")
    p.add_argument("--wind", type=float, nargs=3, default=[0, 0, 0], help="north, east, down, m/s; steady for ArduCopter")
    p.add_argument("--gust", type=float, default=0.0)
    p.add_argument("--noise", type=float, default=1.0)
    p.add_argument("--gyro-noise", type=float, default=0.002)
    p.add_argument("--ground-shake", type=float, default=0.0)
    p.add_argument("--set", nargs="*", default=[], help="parameters set before the companions start: [ROLE:]NAME=VALUE")
    p.add_argument("--bridge-radio", action="store_true", help="the radio of a six hangs on the bridge script (SERVO9)")
    p.add_argument("--chatter", type=float, default=0.0, help="ordinary commands a second from the ground, throughout")
    p.add_argument("--actuation", help="of both vehicles, in place of the frame's")
    p.add_argument("--autopilot-extra", default="", help="lines for [autopilot], separated by ;")
    p.add_argument("--gate", action="store_true", help="put gate.py between autopilots and companions")
    p.add_argument("--do", action="append", default=[])
    p.add_argument("--timeout", type=float, default=240)
    p.add_argument("--missions", type=int, default=1, help="fly that many, companions restarted, autopilots not")
    p.add_argument("--keep", action="store_true", help="leave the autopilots on after the companions end until disarmed (90 s)")
    return p.parse_args()


def short_slices():
    """Normal priority, but a short slice (EEVDF, Linux 6.12): on a busy machine a flight is run soon, not more."""
    import ctypes
    import struct

    try:
        attributes = ctypes.create_string_buffer(struct.pack("IIQiIQQQII", 56, 0, 0, 0, 0, 100000, 0, 0, 0, 0), 56)
        ctypes.CDLL(None, use_errno=True).syscall(314, 0, attributes, 0)
    except (OSError, AttributeError):
        pass


def replaced(pattern, text, by):
    text, count = re.subn(pattern, lambda _: by, text, count=1, flags=re.M | re.S)
    if count != 1:
        raise SystemExit(f"the mission has no {pattern}")
    return text


def mission_of(options, vehicles):
    """The mission's text with its origin, its vehicles' tables and what the options replace."""
    with open(options.mission) as file:
        text = file.read()
    text = replaced(r"^origin = [^\n]*$", text, "origin = { lat_deg = %r, lon_deg = %r, alt_amsl_m = %r }" % tuple(options.origin))
    for vehicle in vehicles:
        airframe, limits = vehicle.vehicle
        limits = limits | dict(one.split("=") for one in options.limit)
        table = [f"[vehicles.{vehicle.role}]", f'airframe = "{airframe}"', *(f"{key} = {value}" for key, value in limits.items())]
        home = options.home_i if vehicle.role == "i" else options.home_j
        table += [f"home_enu_m = {list(home)}", "", ""]
        text = replaced(rf"^\[vehicles\.{vehicle.role}\].*?(?=^\[)", text, "\n".join(table))
    for system, name, gait in moving(options):
        moves = f"moves = {{ system_id = {system}, gait = \"{gait}\", std_m = {NOISE_M} }}"
        text = replaced(rf'^name = "{name}"[^\n]*$', text, f'name = "{name}"\n{moves}')
    if options.area:
        corners = [[x * options.area, y * options.area] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        text = replaced(r"^area_enu_m = [^\n]*$", text, f"area_enu_m = {corners}")
    if options.altitude:
        text = replaced(r"^altitude_m = [^\n]*$", text, f"altitude_m = {options.altitude}")
    if options.slot:
        text = replaced(r"^slot_s = [^\n]*$", text, f"slot_s = {options.slot}")
    if options.settle:
        text = replaced(r"^settle_s = [^\n]*$", text, f"settle_s = {options.settle}")
    if options.optimise:
        text = replaced(r"^optimise = [^\n]*$", text, f'optimise = "{options.optimise}"')
    if options.mode:
        text = replaced(r"^mode = [^\n]*$", text, f'mode = "{options.mode}"')
        text = replaced(r"^superframes = [^\n]*$", text, "superframes = 2")
    return text


def moving(options):
    """MAVLink system of its handset, name and gait of each that moves."""
    return [(system, *one.split("=")) for system, one in enumerate(options.moves, 51)]


class Pair:
    def __init__(self, options):
        self.options = options
        self.folder = os.path.join(os.environ["RUN"], options.name)
        shutil.rmtree(self.folder, ignore_errors=True)
        self.started, self.processes, self.lines, self.events, self.exits = time.time(), {}, [], [], []
        self.seen, self.mission_start = 0, None
        self.vehicles = [FRAMES[getattr(options, role)](role, f"{self.folder}/{role}") for role in ROLES]
        for vehicle in self.vehicles:
            os.makedirs(vehicle.folder)
        # [trigger, action or None when done, when]
        self.todo = [[*one.split("=>", 1), None] for one in options.do]

    def say(self, *what):
        print("[%7.2f]" % (time.time() - self.started), *what, flush=True)

    def spawn(self, key, command, out, cwd=None, environment=None):
        with open(out, "ab") as file:
            self.processes[key] = subprocess.Popen(
                [str(word) for word in command], stdout=file, stderr=subprocess.STDOUT, cwd=cwd, env=environment,
                stdin=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip

    # ---- what runs

    def on_the_bridge(self, vehicle):
        return self.options.bridge_radio and self.options.__dict__[vehicle.role] == "six"

    def vehicle_file(self, vehicle):
        link = ONBOARD + vehicle.k + (10000 if self.options.gate else 0)
        pair = f"udpout:127.0.0.1:{PAIR}" if vehicle.role == "i" else f"udpin:127.0.0.1:{PAIR}"
        with open(f"{self.folder}/vehicle-{vehicle.role}.toml", "w") as file:
            file.write(f"""[vehicle]
role = "{vehicle.role}"
[autopilot]
link = "udpin:127.0.0.1:{link}"
firmware = "{vehicle.firmware}"
actuation = "{self.options.actuation or vehicle.actuation}"
system_id = {vehicle.system}
{self.options.autopilot_extra.replace(';', chr(10))}
[transmitter]
kind = "leased"
simulated = true
{"component_id = 1" if self.on_the_bridge(vehicle) else ""}
[pair]
link = "{pair}"
[log]
dir = "{vehicle.folder}/flight-logs"
""")

    def companion(self, role, number=0):
        log = f'{self.folder}/{role}/companion{number or ""}.log'
        command = [os.environ["VEILWING"], "fly", self.folder + "/mission.toml", "--vehicle", f"{self.folder}/vehicle-{role}.toml"]
        environment = dict(os.environ, RUST_LOG=os.environ.get("RUST_LOG", "info"), NO_COLOR="1")
        self.spawn("companion-" + role, command, log, self.folder, environment)
        threading.Thread(target=self.follow, args=(role, log, self.processes["companion-" + role]), daemon=True).start()

    def follow(self, role, path, process):
        with open(path, errors="replace") as file:
            line = ""
            while True:
                more = file.readline()
                line += more
                if line.endswith("\n"):
                    text = re.sub(r"\x1b\[[0-9;]*m", "", line.rstrip())
                    self.lines.append((time.time(), role, text))
                    self.say(role.upper(), "|", text[:230])
                    line = ""
                elif not more and process.poll() is not None:
                    return
                elif not more:
                    time.sleep(0.02)

    def set_up(self):
        with open(self.folder + "/mission.toml", "w") as file:
            file.write(mission_of(self.options, self.vehicles))
        homes = {vehicle.role: home_of(vehicle.role, self.options) for vehicle in self.vehicles}
        with open(self.folder + "/setup.json", "w") as file:
            json.dump(dict(origin=self.options.origin, homes=homes, args=vars(self.options)), file)
        on_lines = [vehicle for vehicle in self.vehicles if self.on_the_bridge(vehicle)]
        beats = any(vehicle.firmware == "ardupilot" for vehicle in self.vehicles)
        spans = [(vehicle, [self.wanted(vehicle, name) for name in ("VW_DBM_LO", "VW_DBM_HI")]) for vehicle in on_lines]
        self.ground = Ground(self.folder, self.vehicles, self.say, beats, spans)
        self.ground.start()
        for vehicle in self.vehicles:
            vehicle.start(self.spawn, homes[vehicle.role], self.options)
        end = time.time() + 60
        while time.time() < end and len(self.ground.modes) < 2:
            time.sleep(0.1)
        self.say("heartbeats", self.ground.modes)
        for vehicle in self.vehicles:
            self.set_parameters(vehicle)
            if self.options.gate:
                gate = [sys.executable, HERE + "/gate.py", "--instance", vehicle.k]
                self.spawn("gate-" + vehicle.role, gate, vehicle.folder + "/gate.log")
            if vehicle not in on_lines:
                radio = [sys.executable, HERE + "/radio.py", "--instance", vehicle.k, "--port", PAYLOAD + vehicle.k]
                radio += ["--log", f"{self.folder}/tx-{vehicle.role}.log"]
                self.spawn("radio-" + vehicle.role, radio, vehicle.folder + "/radio.out")
            self.vehicle_file(vehicle)
        if self.options.chatter:
            self.ground.chatter(self.options.chatter)
        if self.options.moves:
            with open(self.folder + "/mission.toml", "rb") as file:
                mission = tomllib.load(file)
            nodes = {node["name"]: (kind, node["enu_m"]) for kind in ("user", "eavesdropper") for node in mission[kind]}
            who = [
                dict(name=name, kind=nodes[name][0], enu=nodes[name][1], gait=gait, system=system)
                for system, name, gait in moving(self.options)
            ]
            Movers(self.folder, who, self.options.origin, self.ground).start()

    def set_parameters(self, vehicle):
        wind_speed = sum(x * x for x in self.options.wind[:2]) ** 0.5
        if vehicle.firmware == "ardupilot" and wind_speed:
            import math

            coming_from = math.degrees(math.atan2(-self.options.wind[1], -self.options.wind[0])) % 360
            for name, value in (("SIM_WIND_SPD", wind_speed), ("SIM_WIND_DIR", coming_from), ("SIM_WIND_TURB", self.options.gust)):
                self.ground.set(vehicle, name, value)
        for name, value in self.settings(vehicle):
            self.ground.set(vehicle, name, value)

    def settings(self, vehicle):
        for setting in self.options.set:
            name, value = setting.split("=")
            role, _, name = name.rpartition(":")
            if role in ("", vehicle.role):
                yield name, float(value)

    def wanted(self, vehicle, name):
        return dict(self.settings(vehicle))[name]

    # ---- what is done to it

    def act(self, action):
        what, role, *rest = action.split()
        vehicle = self.vehicles[ROLES.index(role)]
        companion = self.processes.get("companion-" + role)
        self.say("=== DO", action)
        self.events.append((time.time(), action))
        self.ground.note("do", action)
        if what == "kill":
            companion.kill()
        elif what == "term":
            companion.terminate()
        elif what == "stop":
            companion.send_signal(signal.SIGSTOP)
            self.todo.append(["", "continue " + role, time.time() + float(rest[0])])
        elif what == "continue":
            companion.send_signal(signal.SIGCONT)
        elif what == "restart":
            self.companion(role, 9)
        elif what in ("cut", "delay", "loss", "rate"):
            control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            control.sendto(" ".join([what, *rest]).encode(), ("127.0.0.1", GATE_CONTROL + vehicle.k))
        elif what == "pilot":
            self.ground.pilot(vehicle, rest[0])
        elif what == "push":
            self.ground.push(vehicle)
        elif what == "cmd":
            self.ground.command(vehicle.system, 191, int(rest[0]), *map(float, rest[1:]))
        elif what == "gps":
            vehicle.gps_off(self.ground)
        elif what == "param":
            # Without waiting for the answer: what follows is timed from here.
            self.ground.link.mav.param_set_send(vehicle.system, 1, rest[0].encode(), float(rest[1]), 9)
        elif what == "radiokill":
            self.processes["radio-" + role].kill()
        elif what == "burst":
            self.ground.burst(vehicle, int(rest[0]))
        else:
            raise SystemExit(f"unknown action {action}")

    def triggers(self):
        new = self.lines[self.seen :]
        self.seen += len(new)
        for one in self.todo:
            trigger, action, when = one
            if action is None:
                continue
            if when is None and trigger.startswith("t+"):
                when = self.mission_start and self.mission_start + float(trigger[2:])
            elif when is None:
                role, rest = trigger.split("@", 1)
                pattern, seconds = re.match(r"(.*?)(?:\+([\d.]+))?$", rest).groups()
                when = next((at + float(seconds or 0) for at, who, text in new if who == role and re.search(pattern, text)), None)
            one[2] = when
            if when is not None and time.time() >= when:
                one[1] = None
                for part in action.split("&"):
                    self.act(part.strip())

    # ---- the flight

    def fly(self, number):
        base = len(self.lines)
        for role in ROLES:
            self.companion(role, number)
        end, began, asked = time.time() + self.options.timeout, time.time(), False
        while time.time() < end and any(self.processes["companion-" + role].poll() is None for role in ROLES):
            time.sleep(0.02)
            self.triggers()
            ready = {who for _, who, text in self.lines[base:] if re.search(r"waiting: MISSION_START( role|$)", text)}
            if not asked and len(ready) == 2:
                asked, self.mission_start = True, time.time()
                self.say("MISSION_START", "after %.1f s" % (self.mission_start - began))
                self.ground.command(1, 191, 300)
        self.exits.append({role: self.processes["companion-" + role].poll() for role in ROLES})
        self.say("exit codes", self.exits[-1])
        if self.options.keep or number + 1 < self.options.missions:
            end = time.time() + 90
            while time.time() < end and any(armed for _, armed in self.ground.modes.values()):
                time.sleep(0.1)
                self.triggers()
        self.say("at the end", self.ground.modes, "landed", self.ground.landed)

    def finish(self):
        guard = [self.ground.get(v, LNDMC) for v in self.vehicles if v.firmware == "px4"]
        armed = [self.ground.modes.get(v.system, ("", True))[1] for v in self.vehicles]
        lists = {v.role: dict(fence=self.ground.list_of(v, 1), rally=self.ground.list_of(v, 2)) for v in self.vehicles}
        with open(self.folder + "/end.json", "w") as file:
            json.dump(dict(exits=self.exits, guard=guard, armed=armed, missions=self.options.missions, lists=lists), file)
        with open(self.folder + "/events.json", "w") as file:
            json.dump(self.events, file)

    def stop(self):
        for key, process in self.processes.items():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                (process.kill if key.startswith("autopilot") else process.terminate)()
        time.sleep(0.5)
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()


def main():
    options = arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    short_slices()
    pair = Pair(options)
    try:
        pair.set_up()
        for number in range(options.missions):
            pair.fly(number)
        pair.finish()
    finally:
        pair.stop()


main()
