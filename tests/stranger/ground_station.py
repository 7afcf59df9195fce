#!/usr/bin/env python3
"""QGroundControl's connection sequence, replayed by pymavlink in its order.

Version (both requests), protocol version, available modes, component metadata and its predecessor, gimbal manager,
parameters of every component with gaps asked again by index, mission, fence and rally point lists, home, streams.
Whatever a vehicle does not have it must refuse with an acknowledgement: QGroundControl waits for one. The vehicle must
be there already:

    veilwing-sitl vehicle --link udpout:127.0.0.1:14550 --firmware px4
    ground_station.py --link udpin:127.0.0.1:14550

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import collections
import os

os.environ["MAVLINK20"] = "1"
from check import check, run  # noqa: E402
from fly import MAV, Stranger  # noqa: E402

RADIO = 68
# Of each component's list, these are taken for lost, and asked again as QGroundControl does.
LOST = (0, 3, 7)
MESSAGES = {
    "AUTOPILOT_VERSION": 148,
    "PROTOCOL_VERSION": 300,
    "AVAILABLE_MODES": 435,
    "COMPONENT_METADATA": 397,
    "COMPONENT_INFORMATION": 395,
    "GIMBAL_MANAGER_INFORMATION": 280,
    "HOME_POSITION": 242,
}


class GroundStation(Stranger):
    """A ground station that connects."""

    def request(self, name, command=MAV.MAV_CMD_REQUEST_MESSAGE, param1=None):
        """The result of a request for a message, and the message if it came (before or after the answer)."""
        param1 = MESSAGES[name] if param1 is None else param1
        self.link.mav.command_long_send(self.link.target_system, 1, command, 0, param1, 0, 0, 0, 0, 0, 0)
        # What its definitions no longer have, pymavlink calls by number.
        names = (name, f"UNKNOWN_{MESSAGES[name]}")
        got = {}

        def note(m):
            if m.get_type() == "COMMAND_ACK" and m.command == command:
                got["result"] = m.result
            elif m.get_type() in names and m.get_srcComponent() in (0, 1):
                got["message"] = m
            return "result" in got and ("message" in got or got["result"] != MAV.MAV_RESULT_ACCEPTED)

        self.wait(10, ["COMMAND_ACK", *names], note)
        check("result" in got, f"the request for {name} (command {command}) is answered")
        return got["result"], got.get("message")

    def has(self, name, command=MAV.MAV_CMD_REQUEST_MESSAGE, param1=None):
        """A message that must be there."""
        result, message = self.request(name, command, param1)
        check(result == MAV.MAV_RESULT_ACCEPTED and message is not None, f"{name} is sent")
        return message

    def has_not(self, name):
        """A message that must be refused, not ignored."""
        result, message = self.request(name)
        check(
            message is None and result in (MAV.MAV_RESULT_UNSUPPORTED, MAV.MAV_RESULT_DENIED, MAV.MAV_RESULT_FAILED),
            f"{name} is refused ({result})",
        )


def find(s):
    """The vehicle and its firmware."""
    first = s.link.wait_heartbeat(timeout=10)
    check(first is not None, "hears a heartbeat")
    s.link.target_system, s.link.target_component = first.get_srcSystem(), 1
    s.link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, MAV.MAV_STATE_ACTIVE)
    beat = s.heartbeat()
    check(beat is not None, "hears the autopilot's heartbeat")
    check(beat.base_mode & MAV.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, "its mode is in custom_mode")
    return beat.autopilot == MAV.MAV_AUTOPILOT_PX4


def versions(s, px4):
    """AUTOPILOT_VERSION both ways, then what newer and older ground stations ask."""
    asked = s.has("AUTOPILOT_VERSION")
    again = s.has("AUTOPILOT_VERSION", MAV.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    check(asked.capabilities == again.capabilities, "both requests tell the same capabilities")
    major = asked.flight_sw_version >> 24
    check(major == (1 if px4 else 4), f"the version is {major}.{asked.flight_sw_version >> 16 & 0xFF}")
    check(asked.capabilities & MAV.MAV_PROTOCOL_CAPABILITY_MAVLINK2, "it speaks MAVLink 2")
    bytewise = bool(asked.capabilities & MAV.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)
    check(bytewise == px4, "it says how integers ride in parameters")
    if px4:
        s.has("PROTOCOL_VERSION")
        s.has("PROTOCOL_VERSION", MAV.MAV_CMD_REQUEST_PROTOCOL_VERSION, 1)
    else:
        s.has_not("PROTOCOL_VERSION")
    for name in ("AVAILABLE_MODES", "COMPONENT_METADATA", "COMPONENT_INFORMATION", "GIMBAL_MANAGER_INFORMATION"):
        s.has_not(name)


def parameters(s):
    """Every component's whole list; what is lost comes by index."""
    s.link.mav.param_request_list_send(s.link.target_system, MAV.MAV_COMP_ID_ALL)
    counts, values = {}, collections.defaultdict(dict)

    def take(m):
        component = m.get_srcComponent()
        counts[component] = m.param_count
        if m.param_index not in LOST and m.param_index < m.param_count:
            values[component][m.param_index] = m.param_id
        whole = [len(values[c]) + sum(k < n for k in LOST) == n for c, n in counts.items()]
        return {1, RADIO} <= set(counts) and all(whole)

    check(s.wait(20, ["PARAM_VALUE"], take) is not None, f"lists come from components {sorted(counts)}")
    for component, count in counts.items():
        for index in (k for k in range(count) if k not in values[component]):
            s.link.mav.param_request_read_send(s.link.target_system, component, b"", index)
            mine = lambda m, c=component, k=index: (m.get_srcComponent(), m.param_index) == (c, k)  # noqa: E731
            value = s.wait(10, ["PARAM_VALUE"], mine)
            check(value is not None, f"component {component} gives parameter {index} again")
            values[component][index] = value.param_id
        check(len(set(values[component].values())) == count, f"component {component} has {count} different names")


def plans(s):
    """No mission, no fence, no rally points, each said for its own list."""
    for kind, name in enumerate(("mission", "fence", "rally points")):
        s.link.mav.mission_request_list_send(s.link.target_system, 1, kind)
        count = s.wait(10, ["MISSION_COUNT"], lambda m, k=kind: m.mission_type == k)
        check(count is not None and count.count == 0, f"no {name}")
        s.link.mav.mission_ack_send(s.link.target_system, 1, MAV.MAV_MISSION_ACCEPTED, kind)


def streams(s, px4):
    """Home, and telemetry at the rates asked for."""
    home = s.has("HOME_POSITION")
    s.has("HOME_POSITION", MAV.MAV_CMD_GET_HOME_POSITION, 0)
    here = s.wait(5, ["GLOBAL_POSITION_INT"])
    check(here is not None, "tells where it is")
    near = abs(home.latitude - here.lat) < 100 and abs(home.longitude - here.lon) < 100
    check(near, "home is where it stands")
    for name, message in (("HOME_POSITION", 242), ("EXTENDED_SYS_STATE", 245)):
        result = s.command(MAV.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1_000_000)
        check(result == MAV.MAV_RESULT_ACCEPTED, f"{name} is promised once a second")
        s.link.mav.command_long_send(
            s.link.target_system, 1, MAV.MAV_CMD_GET_MESSAGE_INTERVAL, 0, message, 0, 0, 0, 0, 0, 0
        )
        told = s.wait(5, ["MESSAGE_INTERVAL"], lambda m, k=message: m.message_id == k)
        check(told is not None and told.interval_us == 1_000_000, f"{name} has that interval")
    # Superseded, and still what is sent to ArduPilot; PX4 has never listened to it.
    s.link.mav.request_data_stream_send(s.link.target_system, 1, MAV.MAV_DATA_STREAM_EXTRA1, 10, 1)
    times = []
    s.wait(4, ["ATTITUDE"], lambda m: times.append(m.time_boot_ms) or len(times) > 8)
    gaps = sorted(b - a for a, b in zip(times, times[1:]))
    check(len(gaps) > 4, "attitude comes in a stream")
    asked_ms = 250 if px4 else 100
    middle = gaps[len(gaps) // 2]
    check(abs(middle - asked_ms) < 10, f"every {middle} ms of its own time")


def main(arguments):
    s = GroundStation(arguments.link, arguments.speed)
    px4 = find(s)
    versions(s, px4)
    parameters(s)
    plans(s)
    streams(s, px4)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--link", default="udpin:127.0.0.1:14550", help="as pymavlink writes addresses")
parser.add_argument("--speed", type=float, default=1.0, help="the vehicle's --speed, to scale time-outs")
ARGUMENTS = parser.parse_args()
run(lambda: main(ARGUMENTS), 120.0)
