#!/usr/bin/env python3
"""Buttons for the orders: MAVProxy with our module, and QGroundControl's actions sent as QGroundControl sends them.

`veilwing ground-station install` puts the module beside MAVProxy's own, as an operator does. First flight: MAVProxy loads it,
is refused in words, starts, pauses, continues and sends home. Second flight: pymavlink sends what `veilwing.json` says, a
COMMAND_LONG to component 191 of a vehicle, and then what makes vehicles quieter to all (0, 0): pause, and kill.

    buttons.py --program target/debug/veilwing --mission tests/flight/yard.toml --port 14570 --speed 2

Exits 0 if every check holds, 1 otherwise.
"""

import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile

from check import check, run
from companion_flight import ACCEPTED, COMPANION, Flight, Operator, ended, parser


def install(arguments):
    """The module beside MAVProxy's own; QGroundControl's actions where it looks."""
    home = tempfile.TemporaryDirectory()
    (pathlib.Path(home.name) / "Documents" / "QGroundControl").mkdir(parents=True)
    path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    done = subprocess.run(
        [arguments.program, "ground-station", "install"],
        env={**os.environ, "HOME": home.name, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    print(done.stdout + done.stderr, flush=True)
    check(done.returncode == 0 and "mavproxy_veilwing.py" in done.stdout, "both are installed")
    file = pathlib.Path(home.name) / "Documents/QGroundControl/MavlinkActions/veilwing.json"
    actions = {action["label"]: action for action in json.loads(file.read_text())["actions"]}
    home.cleanup()
    return actions


def typed_flight(arguments):
    """Every order of MAVProxy's module but the kill."""
    with Flight(arguments) as flight:
        with Operator(f"udpin:127.0.0.1:{arguments.port}", arguments.port + 1, arguments.speed) as operator:
            operator.both("HEARTBEAT", lambda m: True, 20, "both companions' heartbeats")
            operator.type("module load veilwing")
            operator.said("Loaded module veilwing", 10, "MAVProxy loads our module", operator.shown)
            flight.ready()

            def order(text, words, systems=(1,), what="done"):
                operator.type(f"veilwing {text}")
                for system in systems:
                    name = text.split()[0]
                    answer = rf"veilwing {name}: companion {system}: {what} after"
                    operator.said(answer, 20, f"veilwing {text}", operator.shown)
                if words:
                    operator.says(words, 10, systems)

            operator.type("veilwing fly")
            operator.said("usage: veilwing start", 10, "another word is none", operator.shown)
            order("continue", "continue refused: nothing is paused", what="REFUSES it")
            order("lift", None, (1, 2))
            order("start 2", "preflight passed, taking off", (2,))
            operator.says("slot 0: on", 90)
            order("start", "start refused: in flight", what="REFUSES it")
            order("pause", "paused by the operator")
            order("continue", "going on by the operator")
            operator.type("veilwing status")
            operator.said("veilwing: companion 2 heard", 10, "who is heard", operator.shown)
            order("return", None)
            operator.says("landed and disarmed", 120)
            ended(flight, "the operator's return")


def pressed_flight(arguments, actions):
    """QGroundControl's buttons, and the quieting orders said to all; the kill by MAVProxy's module at the end."""

    def press(operator, label, system, target=None):
        action = actions[label]
        params = [action.get(f"param{k}", 0) for k in range(1, 8)]
        to = (system, action["compId"]) if target is None else target
        operator.type("")
        # MAVProxy passes on what its output says, as it does for a ground station behind it.
        operator.ear.mav.command_long_send(*to, action["mavCmd"], 0, *params)
        mine = lambda m: m.get_srcComponent() == COMPANION and m.command == action["mavCmd"]  # noqa: E731
        answer = operator.wait("COMMAND_ACK", lambda m: mine(m) and m.result != 5, 20, f"{label} to {to}: answered", True)
        check(answer.result == ACCEPTED, f"{label} to {to}: ACCEPTED ({answer.result})")

    with Flight(arguments) as flight:
        with Operator(f"udpin:127.0.0.1:{arguments.port}", arguments.port + 1, arguments.speed) as operator:
            operator.both("HEARTBEAT", lambda m: True, 20, "both companions' heartbeats")
            operator.type("module load veilwing")
            flight.ready()
            press(operator, "Veilwing start", 1)
            operator.says("slot 0: on", 90)
            press(operator, "Veilwing pause", 1, (0, 0))
            operator.says("paused by the operator", 10)
            press(operator, "Veilwing continue", 2)
            operator.says("slot 1: on", 120)
            operator.type("veilwing kill")
            for system in (1, 2):
                answer = rf"veilwing kill: companion {system}: done after"
                operator.said(answer, 20, "veilwing kill", operator.shown)
            operator.says("radio kill", 10)
            press(operator, "Veilwing KILL", 1, (0, 0))
            operator.says("landed and disarmed", 120)
            ended(flight, "the radio kill")
        silence(flight)


def silence(flight):
    """By the world's own record: what was on at the kill, and when it was off."""
    with (flight.path / "timeline.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    on = [any(float(row[name] or 0) > 0 for name in ("i_power_w", "j_power_w")) for row in rows]
    last = max(k for k, is_on in enumerate(on) if is_on)
    events = [json.loads(line) for line in (flight.path / "events.jsonl").read_text().splitlines()]
    killed = min(event["at_s"] for event in events if event["text"].startswith("radio kill"))
    at = float(rows[last + 1]["at_s"])
    check(at - killed < 0.5, f"both radios off {1e3 * (at - killed):.0f} ms after the first companion heard of the kill")


def main(arguments):
    actions = install(arguments)
    typed_flight(arguments)
    pressed_flight(arguments, actions)


ARGUMENTS = parser(__doc__).parse_args()
run(lambda: main(ARGUMENTS), 60.0 + 600.0 / ARGUMENTS.speed)
