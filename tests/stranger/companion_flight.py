"""Flights of both companions that a ground station watches, and MAVProxy as their operator."""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

from check import check
from mavproxy_driver import MavProxy

COMPANION = 191
ACCEPTED, DENIED, UNSUPPORTED, IN_PROGRESS, INT_ONLY = 0, 2, 3, 5, 8
# The system that the vehicle file has for an operator.
OPERATOR = 255
MISSION_START, PAUSE_CONTINUE, RETURN, RADIO_KILL, UNKNOWN = 300, 193, 20, 31011, 31012
REQUEST_MESSAGE, AUTOPILOT_VERSION, COMPONENT_INFORMATION_BASIC = 512, 148, 396
# Answers of MAVProxy's own words.
WORDS = {ACCEPTED: "ACCEPTED", DENIED: "DENIED", UNSUPPORTED: "UNSUPPORTED", INT_ONLY: "COMMAND_INT_ONLY"}


def parser(description, ports="two", speed=2.0):
    """What every program takes that flies so."""
    told = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    told.add_argument("--program", required=True, help="the veilwing program")
    told.add_argument("--mission", required=True, help="mission file")
    told.add_argument("--port", type=int, default=14570, help=f"{ports} UDP ports of this machine, from this one on")
    told.add_argument("--speed", type=float, default=speed, help="simulated seconds per second")
    return told


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
        """A STATUSTEXT of the companions of these systems; of one in several chunks the first is read."""
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
    broken = [f"{v['invariant']} at {v['at_s']} s: {v}" for v in summary["violations"]]
    check(broken == [], "no invariant is violated" + "".join(f"; {text}" for text in broken))
    check(flight.process.returncode == 1, "the program exits with 1")
