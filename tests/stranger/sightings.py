#!/usr/bin/env python3
"""MAVProxy tells companion I where somebody is that moves, and an operator edits the mission file.

Starts `veilwing sitl` with a mission in which an eavesdropper moves, and nobody else. MAVProxy's own `command_int` says
where it was seen, to I and to J, where half a minute ago, and of one that does not move; then the file is edited, and the
companions get SIGUSR1. Every answer must be truthful.

    sightings.py --program target/debug/veilwing --mission tests/flight/yard.toml --port 14570 --speed 2

Exits 0 if every check holds, 1 otherwise.
"""

import os
import pathlib
import signal
import tempfile

from check import check, run
from companion_flight import (
    ACCEPTED,
    COMPANION,
    DENIED,
    INT_ONLY,
    MISSION_START,
    RETURN,
    Flight,
    Operator,
    ended,
    parser,
)

SIGHTING = 31014
LATITUDE, LONGITUDE = 500753500, 144381000


def companions(parent):
    """The processes of both companions, by role."""
    found = {}
    for path in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            ppid = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            words = (path / "cmdline").read_text().split("\0")
        except (OSError, ValueError):
            continue
        if ppid == parent and "fly" in words:
            vehicle = next(word for word in words if word.endswith(".toml") and "vehicle" in word)
            found["i" if "-i" in pathlib.Path(vehicle).name else "j"] = int(path.name)
    check(set(found) == {"i", "j"}, "both companions run")
    return found


def sighting(operator, system, result, what, kind=1, number=1, age_s=0):
    """A sighting as typed, and its answer. The simulated world's own operator tells of the same eavesdropper each second."""
    operator.type(f"set target_system {system}")
    operator.type(f"set target_component {COMPANION}")
    operator.type(f"command_int GLOBAL {SIGHTING} 0 0 {kind} {number} 8 {age_s} {LATITUDE} {LONGITUDE} 203.5")
    mine = lambda m: (m.get_srcSystem(), m.get_srcComponent()) == (system, COMPANION)  # noqa: E731
    answers = lambda m: mine(m) and m.command == SIGHTING  # noqa: E731
    answer = operator.wait("COMMAND_ACK", answers, 10, f"{what}: answered", since_typed=True)
    check(answer.result == result, f"{what}: {answer.result}")


def fly(arguments):
    """The flight."""
    with tempfile.TemporaryDirectory() as directory:
        mission = pathlib.Path(directory) / "mission.toml"
        head, first, rest = pathlib.Path(arguments.mission).read_text().partition("enu_m = [35.0, -20.0, 2.0]\n")
        check(bool(first), "the mission has the eavesdropper that is to move")
        moves = 'moves = { gait = "walks", std_m = 5.0 }\n'
        mission.write_text(head + first + moves + rest)
        arguments.mission = str(mission)
        with Flight(arguments) as flight:
            port = arguments.port
            with Operator(f"udpin:127.0.0.1:{port}", port + 1, arguments.speed) as operator:
                operator.both("HEARTBEAT", lambda m: True, 20, "both companions' heartbeats")
                flight.ready()
                sighting(operator, 1, ACCEPTED, "the eavesdropper that moves, to I")
                sighting(operator, 1, DENIED, "where it was half a minute ago", age_s=30)
                operator.says("a sighting refused: a later report is known", 10, (1,))
                sighting(operator, 1, DENIED, "one that does not", number=2)
                operator.says("a sighting refused: in the mission", 10, (1,))
                sighting(operator, 2, DENIED, "the eavesdropper that moves, to J")
                operator.says("vehicle I is to be told", 10, (2,))
                operator.command(1, SIGHTING, INT_ONLY, "a sighting by COMMAND_LONG", 1)
                edit(operator, companions(flight.process.pid), mission)
                operator.command(1, MISSION_START, ACCEPTED, "start")
                operator.says("slot 0: on", 90)
                operator.command(1, RETURN, ACCEPTED, "return")
                operator.says("landed and disarmed", 90)
                ended(flight, "the operator's return")


def edit(operator, processes, mission):
    """Where it is, a key that must not change, and what is no mission at all."""
    edited = mission.read_text().replace("[35.0, -20.0, 2.0]", "[30.0, -22.0, 2.0]")
    for text, says in [
        (edited.replace("slot_s = 5.0", "slot_s = 6.0"), "taken: `tdma.slot"),
        (edited.replace("slot_s = 5.0", "slot_s = five"), "taken: it has err"),
        (edited, "1 of those that move are elsewhere"),
    ]:
        mission.write_text(text)
        operator.type("")
        os.kill(processes["i"], signal.SIGUSR1)
        operator.says(says, 10, (1,))
    os.kill(processes["j"], signal.SIGUSR1)
    operator.says("taken: vehicle I's", 10, (2,))


ARGUMENTS = parser(__doc__).parse_args()
run(lambda: fly(ARGUMENTS), 60.0 + 300.0 / ARGUMENTS.speed)
