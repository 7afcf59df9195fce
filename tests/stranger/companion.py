#!/usr/bin/env python3
"""MAVProxy and MAVSDK as ground stations of the pair: they see and command both companions of simulated flights.

Starts `veilwing sitl` twice. First flight: MAVProxy sees both companions, starts the mission, pauses it and lets it go
on; MAVSDK, behind MAVProxy, reads the companions and orders the return. Second flight: MAVSDK starts the mission,
MAVProxy kills the radios while both are on. Every answer must be truthful, also the refusals.

    companion.py --program target/debug/veilwing --mission tests/flight/yard.toml --port 14570 --speed 3

Exits 0 if every check holds, 1 otherwise.
"""

import json
import time

from check import check, run
from companion_flight import (
    ACCEPTED,
    COMPANION,
    DENIED,
    MISSION_START,
    OPERATOR,
    PAUSE_CONTINUE,
    RADIO_KILL,
    RETURN,
    UNKNOWN,
    UNSUPPORTED,
    WORDS,
    Flight,
    Operator,
    ended,
    parser,
)
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ProtocolVersion


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


ARGUMENTS = parser(__doc__, ports="three", speed=3.0).parse_args()
run(lambda: main(ARGUMENTS), 60.0 + 600.0 / ARGUMENTS.speed)
