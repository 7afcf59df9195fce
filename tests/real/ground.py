"""The ground station of a flight: hears both autopilots on one port, keeps a record, gives commands and sets parameters."""

import json
import threading
import time

from pymavlink import mavutil

from autopilots import GROUND, PowerLine, Truth

ROLES = "ij"


class Ground(threading.Thread):
    def __init__(self, folder, vehicles, say, beats, power_lines):
        super().__init__(daemon=True)
        self.folder, self.vehicles, self.say, self.beats = folder, vehicles, say, beats
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{GROUND}", source_system=255, source_component=190, dialect="ardupilotmega"
        )
        self.file = open(folder + "/gcs.log", "a", buffering=1)
        self.modes, self.landed, self.parameters, self.asked, self.sticks = {}, {}, {}, {}, {}
        self.acknowledged, self.counts, self.items = [], {}, {}
        self.truth = {v.system: Truth(v.folder) for v in vehicles if v.streams}
        self.lines = {
            v.system: PowerLine(f"{folder}/tx-{v.role}.log", lambda **k: json.dumps(k) + "\n", span) for v, span in power_lines
        }

    def note(self, *what):
        self.file.write(json.dumps([time.time(), *what]) + "\n")

    def run(self):
        beat = sticks = 0.0
        while True:
            now = time.time()
            try:
                if self.beats and now > beat:
                    beat = now + 1
                    self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
                    # UTC for those that take it from here: ArduCopter's simulated receiver is as late as its start was long.
                    self.link.mav.system_time_send(int(time.time() * 1e6), 0)
                if self.sticks and now > sticks:
                    sticks = now + 0.2
                    for system, pitch_us in list(self.sticks.items()):
                        self.link.mav.rc_channels_override_send(system, 1, 1500, pitch_us, 1500, 1500, *[65535] * 4)
                message = self.link.recv_match(blocking=True, timeout=0.05)
            except OSError:
                continue
            source = message and (message.get_srcSystem(), message.get_srcComponent())
            if message is not None and message.get_type() != "BAD_DATA" and source[0] in (1, 2):
                self.take(message, source)

    def take(self, m, source):
        kind, now, vehicle = m.get_type(), time.time(), self.vehicles[source[0] - 1]
        own = source[1] == 1
        if kind == "STATUSTEXT":
            self.note("text", source, m.severity, m.text)
            if own:
                self.say(f"autopilot {vehicle.role}: {m.text}")
        elif kind == "HEARTBEAT" and own:
            state = vehicle.mode_name(m.custom_mode), bool(m.base_mode & 128)
            if self.modes.get(source[0]) != state:
                self.modes[source[0]] = state
                self.note("mode", source, *state)
                self.say(f"autopilot {vehicle.role}: mode", state[0], "armed" if state[1] else "disarmed")
            self.ask_for_streams(vehicle)
        elif kind == "EXTENDED_SYS_STATE" and own and self.landed.get(source[0]) != m.landed_state:
            self.landed[source[0]] = m.landed_state
            self.note("landed", source, m.landed_state)
        elif kind == "COMMAND_ACK":
            self.acknowledged.append((source, m.command, m.result))
            self.note("ack", source, m.command, m.result, m.target_system, m.target_component)
        elif kind == "PARAM_VALUE" and own:
            self.parameters[(source[0], m.param_id)] = vehicle.decoded(m), m.param_type
        elif kind == "MISSION_COUNT" and own:
            self.counts[(source[0], m.mission_type)] = m.count
        elif kind == "MISSION_ITEM_INT" and own:
            self.items[(source[0], m.mission_type, m.seq)] = m.command, m.param1, m.x * 1e-7, m.y * 1e-7
        elif kind == "SYSTEM_TIME" and own and source[0] in self.truth:
            self.truth[source[0]].boot_s = m.time_boot_ms / 1e3
        elif kind in ("SIM_STATE", "HIL_STATE_QUATERNION") and source[0] in self.truth:
            self.asked[source[0]] = now
            if self.truth[source[0]].boot_s:
                self.truth[source[0]].put(now, m, self.modes.get(source[0], ("", False))[1])
        elif kind == "SERVO_OUTPUT_RAW" and source[0] in self.lines:
            self.lines[source[0]].put(now, m.servo9_raw)

    def ask_for_streams(self, vehicle):
        """Again with every heartbeat until the true state comes."""
        if time.time() - self.asked.get(vehicle.system, 0.0) > 1.0:
            for message, rate in vehicle.streams:
                self.command(vehicle.system, 1, 511, message, 1e6 / rate)

    def handset(self, system):
        """What sends as another system, to both autopilots, which pass it on."""
        return type(self.link.mav)(self.link, srcSystem=system, srcComponent=1)

    def get(self, vehicle, name):
        """The value, or None after four seconds."""
        key = vehicle.system, name
        for _ in range(6):
            self.parameters.pop(key, None)
            self.link.mav.param_request_read_send(vehicle.system, 1, name.encode(), -1)
            end = time.time() + 0.7
            while time.time() < end:
                if key in self.parameters:
                    return self.parameters[key][0]
                time.sleep(0.02)
        return None

    def set(self, vehicle, name, value):
        before = self.get(vehicle, name)
        if before is None:
            return self.say("parameter", name, "is not known to", vehicle.role)
        kind = self.parameters[(vehicle.system, name)][1]
        for _ in range(5):
            self.link.mav.param_set_send(
                vehicle.system, 1, name.encode(), vehicle.encoded(value, kind == 6), kind
            )
            time.sleep(0.3)
            now = self.get(vehicle, name)
            if now is not None and abs(now - value) < 1e-6:
                break
        self.say("parameter", vehicle.role, name, before, "->", now)

    def until(self, ask, known):
        """What is known once it is, asked for four times at most; else None."""
        for _ in range(4):
            ask()
            end = time.time() + 1.0
            while time.time() < end:
                if known() is not None:
                    return known()
                time.sleep(0.02)
        return None

    def list_of(self, vehicle, kind):
        """Its fence (1) or its rally points (2): command, first parameter, latitude and longitude of each; None without an answer."""
        mav, system = self.link.mav, vehicle.system
        self.counts.pop((system, kind), None)
        count = self.until(
            lambda: mav.mission_request_list_send(system, 1, kind), lambda: self.counts.get((system, kind))
        )
        found = []
        for seq in range(count or 0):
            self.items.pop((system, kind, seq), None)
            found.append(
                self.until(
                    lambda: mav.mission_request_int_send(system, 1, seq, kind),
                    lambda: self.items.get((system, kind, seq)),
                )
            )
        mav.mission_ack_send(system, 1, 0, kind)
        return None if count is None else found

    def command(self, system, component, command, *p):
        p = (list(p) + [0] * 7)[:7]
        self.note("command", system, component, command, p)
        self.link.mav.command_long_send(system, component, command, 0, *p)

    def pilot(self, vehicle, mode):
        """The pilot changes the mode; on ArduPilot with the sticks centred."""
        if vehicle.firmware == "ardupilot":
            self.sticks[vehicle.system] = 1500
        self.command(vehicle.system, 1, 176, 1, *vehicle.modes[mode])

    def push(self, vehicle):
        """The pilot holds and then flies ahead, as far as the autopilot lets him; ArduCopter alone."""
        self.pilot(vehicle, "hold")
        self.sticks[vehicle.system] = 1200

    def burst(self, vehicle, count):
        """Ordinary commands of anybody, all at once (MAV_CMD_REQUEST_MESSAGE for HOME_POSITION)."""
        mav = self.link.mav
        for _ in range(count):
            mav.command_long_send(vehicle.system, 1, 512, 0, 242, 0, 0, 0, 0, 0, 0)

    def chatter(self, rate):
        """That many ordinary commands a second to each autopilot, ten at once, for good."""

        def run():
            while True:
                for vehicle in self.vehicles:
                    self.burst(vehicle, 10)
                time.sleep(10.0 / rate)

        threading.Thread(target=run, daemon=True).start()
