#!/usr/bin/env python3
"""MAVProxy and MAVSDK as ground stations of the pair: they see and command both companions of simulated flights.

Starts `veilwing sitl` twice. First flight: MAVProxy sees both companions, starts the mission, pauses it and lets it go
on; MAVSDK, behind MAVProxy, reads the companions and orders the return. Second flight: MAVSDK starts the mission,
MAVProxy kills the radios while both are on. Every answer must be truthful, also the refusals.

    companion.py --program target/debug/veilwing --mission tests/flight/yard.toml --port 14570 --speed 3

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

from check import check, run
from mavproxy_driver import MavProxy
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ProtocolVersion

COMPANION = 191
ACCEPTED, DENIED, UNSUPPORTED, IN_PROGRESS = 0, 2, 3, 5
# The system that the vehicle file has for an operator.
OPERATOR = 255
MISSION_START, PAUSE_CONTINUE, RETURN, RADIO_KILL, UNKNOWN = 300, 193, 20, 31011, 31012
REQUEST_MESSAGE, AUTOPILOT_VERSION, COMPONENT_INFORMATION_BASIC = 512, 148, 396
# Answers of MAVProxy's own words.
WORDS = {ACCEPTED: "ACCEPTED", DENIED: "DENIED", UNSUPPORTED: "UNSUPPORTED"}


class Flight:
    """One `veilwing sitl` that waits for the ground station's start."""

    def __init__(self, arguments):
        self.directory = tempfile.TemporaryDirectory()
        self.path = pathlib.Path(self.directory.name)
        self.log = (self.path / "progress.log").open("w+")
        self.process = subprocess.Popen(
            [arguments.program, "sitl", arguments.mission, "--speed", str(arguments.speed), "--wait-for-start"]
            + ["--ground-station", f"udpout:127.0.0.1:{arguments.port}", "--out", str(self.path)],
            stdout=subprocess.DEVNULL,
            stderr=self.log,
        )

    def summary(self, limit_s):
        """The flight's own document, after its end."""
        try:
            self.process.wait(limit_s)
        except subprocess.TimeoutExpired:
            check(False, f"the flight ends within {limit_s} s")
        return json.loads((self.path / "summary.json").read_text())

    def ready(self):
        """Nothing is missing but the start, as the flight's own log has it."""
        end, waiting = time.monotonic() + 30.0, 0
        while time.monotonic() < end and waiting < 2:
            time.sleep(0.1)
            waiting = (self.path / "progress.log").read_text().count("waiting: MISSION_START")
        check(waiting >= 2, "both companions wait for the start alone")

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.process.terminate()
        self.process.wait()
        if kind is not None:
            self.log.seek(0)
            print("".join(f"     sitl: {line}" for line in self.log.readlines()[-40:]), flush=True)
        self.log.close()
        self.directory.cleanup()


class Sdk:
    """MAVSDK, behind one of MAVProxy's outputs."""

    def __init__(self, port):
        configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        configuration.system_id = OPERATOR
        self.mavsdk = Mavsdk(configuration)
        self.mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        end = time.monotonic() + 20.0
        self.systems = {}
        while time.monotonic() < end and not self.complete():
            self.systems = {s.get_system_id(): s for s in self.mavsdk.get_systems()}
            time.sleep(0.1)
        check(self.complete(), f"MAVSDK sees systems {sorted(self.systems)} with component {COMPANION} each")
        self.direct = {k: MavlinkDirect(s) for k, s in self.systems.items()}

    def complete(self):
        """Both companions are known."""
        return {1, 2} <= set(self.systems) and all(
            COMPANION in self.systems[k].component_ids() for k in (1, 2)
        )

    def command(self, system, command, result, what, param1=0.0):
        """A command to a companion, and its MAV_RESULT."""
        fields = {"target_system": system, "target_component": COMPANION, "command": command, "param1": param1}
        fields |= {f"param{k}": 0.0 for k in range(2, 8)} | {"confirmation": 0}
        message = MavlinkMessage("COMMAND_LONG", 0, 0, system, COMPANION, json.dumps(fields))
        answer = json.loads(self.direct[system].send_command(message).fields_json)
        check(answer["result"] == result, f"MAVSDK: {what}: {WORDS[result]} ({answer['result']})")

    def hears(self, system, kind, what):
        """A message of a companion."""
        found = []

        def note(message, _user_data):
            if message.component_id == COMPANION:
                found.append(message)

        handle = self.direct[system].subscribe_message(kind, note)
        end = time.monotonic() + 20.0
        while time.monotonic() < end and not found:
            time.sleep(0.05)
        self.direct[system].unsubscribe_message(handle)
        check(bool(found), f"MAVSDK: {what}")
        return json.loads(found[0].fields_json)

    def parameters(self, system, role):
        """The companion's own parameters: all of them, one that may be written, one that may not."""
        param = Param(self.systems[system])
        try:
            param.select_component(COMPANION, ProtocolVersion.V1)
        except ParamError as error:
            # MAVSDK 4.1 selects it, and then says that it does not know how that went.
            check("UNKNOWN" in str(error), "MAVSDK: turns to the companion's parameters")
        every = {p.name: p.value for p in param.get_all_params().float_params}
        check(len(every) >= 10, f"MAVSDK: reads {len(every)} parameters of companion {system}: {', '.join(every)}")
        check(every.get("VW_ROLE") == role, f"MAVSDK: whose role is {role}")
        param.set_param_float("VW_LIVE_HZ", 15.0)
        check(param.get_param_float("VW_LIVE_HZ") == 15.0, "MAVSDK: sets VW_LIVE_HZ and reads it back")
        refused = None
        try:
            param.set_param_float("VW_LEASE_MS", 900.0)
        except ParamError as error:
            refused = error
        check(refused is not None, f"MAVSDK: VW_LEASE_MS is refused ({refused})")
        check(param.get_param_float("VW_LEASE_MS") == every["VW_LEASE_MS"], "MAVSDK: and stays what it was")


class Operator(MavProxy):
    """MAVProxy with what is asked of companions."""

    def both(self, kind, accept, simulated_s, what):
        """A message from each companion."""
        left = {1, 2}

        def take(m):
            if m.get_srcComponent() == COMPANION and accept(m):
                left.discard(m.get_srcSystem())
            return not left

        self.wait(kind, take, simulated_s, what)

    def says(self, text, simulated_s, systems=(1, 2)):
        """A STATUSTEXT of the companions of these systems."""
        left = set(systems)

        def take(m):
            if m.get_srcComponent() == COMPANION and text in m.text:
                left.discard(m.get_srcSystem())
            return not left

        who = " and ".join(map(str, systems))
        self.wait("STATUSTEXT", take, simulated_s, f'companion {who} says "{text}"', since_typed=True)

    def parameters(self, system, role):
        """The companion's own parameters, as an operator types for them."""
        self.type(f"vehicle {system}:{COMPANION}")
        self.type("param fetch")
        self.said("Received 12 parameters", 20, f"MAVProxy has the parameters of companion {system}", self.shown)
        self.type("param show VW_*")
        self.said(f"VW_ROLE +{role}", 10, f"MAVProxy shows whose role is {role}", self.shown)
        self.said("VW_LEASE_MS +500", 10, "MAVProxy shows how long a lease is", self.shown)
        self.type("param set VW_LIVE_HZ 20")
        mine = lambda m: (m.get_srcSystem(), m.get_srcComponent()) == (system, COMPANION)  # noqa: E731
        taken = lambda m: mine(m) and (m.param_id, m.param_value) == ("VW_LIVE_HZ", 20.0)  # noqa: E731
        self.wait("PARAM_VALUE", taken, 10, "VW_LIVE_HZ is set", since_typed=True)
        self.type("param set VW_LEASE_MS 900")
        stays = lambda m: mine(m) and (m.param_id, m.param_value) == ("VW_LEASE_MS", 500.0)  # noqa: E731
        self.wait("PARAM_VALUE", stays, 10, "VW_LEASE_MS is refused: it stays 500", since_typed=True)
        self.says("VW_LEASE_MS", 10, (system,))

    def who(self, system):
        """Who the companion is: AUTOPILOT_VERSION, and COMPONENT_INFORMATION_BASIC as far as definitions still go."""
        mine = lambda m: (m.get_srcSystem(), m.get_srcComponent()) == (system, COMPANION)  # noqa: E731
        self.command(system, REQUEST_MESSAGE, ACCEPTED, "its version", AUTOPILOT_VERSION)
        told = self.wait("AUTOPILOT_VERSION", mine, 10, "the companion tells its version", since_typed=True)
        version = ".".join(str(told.flight_sw_version >> shift & 0xFF) for shift in (24, 16, 8))
        check(told.flight_sw_version > 0, f"which is {version}")
        # pymavlink's present definitions are without it: a number for a name, and no sender.
        self.command(system, REQUEST_MESSAGE, ACCEPTED, "who it is", COMPONENT_INFORMATION_BASIC)
        self.wait(f"UNKNOWN_{COMPONENT_INFORMATION_BASIC}", lambda m: True, 10, "and who it is", since_typed=True)

    def live(self):
        """Live figures of both companions in a slot."""
        names = {(k, name) for k in (1, 2) for name in ("SEC_RATE", "SINR_USER", "SINR_EVE", "TX_DBM")}
        rates = {}

        def take(m):
            who = (m.get_srcSystem(), m.name)
            names.discard(who)
            if m.name == "SEC_RATE":
                rates[who[0]] = max(m.value, rates.get(who[0], 0.0))
            return not names and len(rates) == 2 and min(rates.values()) > 0.0

        self.wait("NAMED_VALUE_FLOAT", take, 30, "live figures of both companions: secrecy rate, SINRs, power")
        told = ", ".join(f"{rate / 1e6:.2f} Mbit/s by companion {k}" for k, rate in sorted(rates.items()))
        check(True, f"secrecy rate: {told}")

    def command(self, system, command, result, what, param1=0):
        """A command to a companion as typed, and the answer that MAVProxy passes on and shows."""
        self.type(f"vehicle {system}:{COMPANION}")
        self.type(f"long {command} {param1}")
        mine = lambda m: (m.get_srcSystem(), m.get_srcComponent()) == (system, COMPANION)  # noqa: E731
        answers = lambda m: mine(m) and m.command == command and m.result != IN_PROGRESS  # noqa: E731
        answer = self.wait("COMMAND_ACK", answers, 10, f"{what}: answered", since_typed=True)
        check(answer.result == result, f"MAVProxy: {what}: {WORDS[result]} ({answer.result})")
        # It keeps the answers to requests for messages to itself.
        if command != REQUEST_MESSAGE:
            self.said(f"Got COMMAND_ACK: .*{WORDS[result]}", 10, "MAVProxy shows the answer", self.shown)


def ended(flight, why):
    """Home and down, nothing broken."""
    summary = flight.summary(60.0)
    check(summary["result"] == "aborted", f"the flight is told as aborted: {why}")
    broken = [f"{v['invariant']} at {v['t_s']} s: {v}" for v in summary["violations"]]
    check(broken == [], "no invariant is violated" + "".join(f"; {text}" for text in broken))
    check(flight.process.returncode == 1, "the program exits with 1")


def first_flight(arguments):
    """Seen, started, paused and continued from MAVProxy; read and sent home from MAVSDK."""
    port = arguments.port
    sdk_output = f"--out=udpout:127.0.0.1:{port + 2}"
    with Flight(arguments) as flight:
        with Operator(f"udpin:127.0.0.1:{port}", port + 1, arguments.speed, sdk_output) as operator:
            onboard = lambda m: (m.type, m.autopilot) == (18, 8)  # noqa: E731
            operator.both("HEARTBEAT", onboard, 20, "both companions' heartbeats: onboard controllers, no autopilots")
            for system in (1, 2):
                operator.said(f"Detected vehicle {system}:{COMPANION}", 10, "MAVProxy lists the companion")
            sdk = Sdk(port + 2)
            for system in (1, 2):
                sdk.hears(system, "HEARTBEAT", f"hears companion {system}")
                operator.parameters(system, system - 1)
                sdk.parameters(system, float(system - 1))
            operator.who(1)
            operator.command(1, UNKNOWN, UNSUPPORTED, "a command that no companion has")
            flight.ready()
            operator.command(1, PAUSE_CONTINUE, DENIED, "continue on the ground", 1)
            operator.command(1, PAUSE_CONTINUE, ACCEPTED, "pause on the ground: no start any more")
            operator.says("the start was taken back", 10)
            operator.command(1, MISSION_START, ACCEPTED, "start")
            operator.says("preflight passed, taking off", 10)
            operator.command(2, MISSION_START, DENIED, "start once more")
            operator.says("slot 0: on", 60)
            operator.live()
            operator.command(1, PAUSE_CONTINUE, ACCEPTED, "pause", 0)
            operator.says("paused by the operator", 10)
            operator.command(2, PAUSE_CONTINUE, ACCEPTED, "continue", 1)
            operator.says("going on by the operator", 10)
            sdk.command(1, MISSION_START, DENIED, "start in flight")
            sdk.command(2, RETURN, ACCEPTED, "return")
            operator.says("landed and disarmed", 90)
            ended(flight, "the operator's return")


def second_flight(arguments):
    """Started from MAVSDK, silenced for good from MAVProxy."""
    port = arguments.port
    sdk_output = f"--out=udpout:127.0.0.1:{port + 2}"
    with Flight(arguments) as flight:
        with Operator(f"udpin:127.0.0.1:{port}", port + 1, arguments.speed, sdk_output) as operator:
            operator.both("HEARTBEAT", lambda m: True, 20, "both companions' heartbeats")
            flight.ready()
            Sdk(port + 2).command(2, MISSION_START, ACCEPTED, "start at vehicle J")
            operator.says("slot 0: on", 90)
            operator.command(2, RADIO_KILL, ACCEPTED, "radio kill")
            operator.says("radio kill", 10)
            operator.says("landed and disarmed", 90)
            ended(flight, "the radio kill")


def main(arguments):
    first_flight(arguments)
    second_flight(arguments)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--program", required=True, help="the veilwing program")
parser.add_argument("--mission", required=True, help="mission file")
parser.add_argument("--port", type=int, default=14570, help="three UDP ports of this machine, from this one on")
parser.add_argument("--speed", type=float, default=3.0, help="simulated seconds per second")
ARGUMENTS = parser.parse_args()
run(lambda: main(ARGUMENTS), 60.0 + 600.0 / ARGUMENTS.speed)
