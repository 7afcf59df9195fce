"""Commands a real `veilwing radio` process with pymavlink, by docs/radio.md and its message definition alone, signed.

    python3 tests/stranger/radio_commander.py --program target/debug/veilwing --definitions message_definitions/veilwing_radio.xml

The device is two shell scripts that write down what they were told. Checked: who it is, what it declares, every result that the
document has but the device's own troubles, rounding, expiry, kill and lifting; and that forged, replayed and unsigned
commands change nothing and are counted.
"""
import argparse
import math
import os
import pathlib
import re
import signal
import socket
import subprocess
import tempfile
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import common as mav
from pymavlink.generator import mavgen

from check import check, run

KEY = bytes(range(1, 33))
SYSTEM, COMPANION, RADIO = 1, 191, 68
POWER, KILL = 31010, 31011
OFF = -(2**31)
RESULTS = {}


def add_definition(xml):
    """Has pymavlink's common dialect know the message as well."""
    with tempfile.TemporaryDirectory() as directory:
        output = os.path.join(directory, "radio_dialect.py")
        options = mavgen.Opts(output, wire_protocol="2.0", language="Python3", validate=False)
        if not mavgen.mavgen(options, [os.path.abspath(xml)]):
            raise SystemExit(f"pymavlink cannot generate code from {xml}")
        names = {}
        exec(compile(pathlib.Path(output).read_text(), output, "exec"), names)
    mav.mavlink_map[42120] = names["mavlink_map"][42120]
    for value, entry in names["enums"]["VEILWING_RADIO_RESULT"].items():
        RESULTS[value] = entry.name.removeprefix("VEILWING_RADIO_RESULT_")


class Commander:
    """One end of the link: a companion, or somebody who only says so."""

    def __init__(self, port, key=KEY, link_id=2, boot=7):
        self.to = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.mav = mav.MAVLink(None, SYSTEM, COMPANION)
        self.mav.robust_parsing = True
        if key:
            self.mav.signing.secret_key = key
            self.mav.signing.link_id = link_id
            # Since 2015, in units of 10 us.
            self.mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)
            self.mav.signing.sign_outgoing = True
        self.boot, self.number, self.series, self.time_ms = boot, 0, 0, 0
        self.frames, self.said = [], []

    def send(self, message):
        frame = message.pack(self.mav)
        self.frames.append(frame)
        self.socket.sendto(frame, self.to)

    def hear(self, seconds):
        """Messages of so long."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self.socket.settimeout(left)
            try:
                datagram = self.socket.recv(2048)
            except (TimeoutError, ConnectionRefusedError):
                continue
            for message in self.mav.parse_buffer(datagram) or []:
                if message.get_type() == "BAD_DATA":
                    continue
                if message.get_type() == "VEILWING_RADIO":
                    self.series, self.time_ms = message.series, message.time_ms
                if message.get_type() == "STATUSTEXT":
                    self.said.append(message.text)
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    self.send(mav.MAVLink_timesync_message(int(time.time() * 1e9), message.ts1))
                yield message

    def beat(self):
        self.send(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))

    def awaited(self, kind, matches, seconds=8.0):
        """The first such message; says HEARTBEAT meanwhile, so that the radio knows where it is."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.beat()
            for message in self.hear(0.25):
                if message.get_type() == kind and matches(message):
                    return message
        check(False, f"no such {kind} in {seconds} s")

    def report(self):
        """The next one that is unasked, what waits in the socket aside."""
        for _ in self.hear(0.05):
            pass
        return self.awaited("VEILWING_RADIO", lambda m: m.answers == 0)

    def power(self, dbm, ahead_ms, **fields):
        """The command of docs/radio.md."""
        self.number += 1
        given = {"number": self.number, "boot": self.boot, "series": self.series, **fields}
        expiry = (self.time_ms + ahead_ms) % 2**32
        signed = expiry - 2**32 if expiry >= 2**31 else expiry
        return mav.MAVLink_command_int_message(
            SYSTEM, RADIO, 0, POWER, 0, 0, dbm, given["number"], given["boot"], given["series"], 0, signed, 0.0
        )

    def give(self, dbm, ahead_ms, **fields):
        """Commands, and the answer to that."""
        command = self.power(dbm, ahead_ms, **fields)
        self.send(command)
        wanted = (int(command.param3), int(command.param2))
        return self.awaited("VEILWING_RADIO", lambda m: (m.answers_boot, m.answers) == wanted)

    def result(self, dbm, ahead_ms, **fields):
        return RESULTS[self.give(dbm, ahead_ms, **fields).result]


def radio_file(directory, port):
    """A signed radio whose device writes down what it is told."""
    key = directory / "radio.key"
    key.write_text(KEY.hex() + "\n")
    key.chmod(0o600)
    sh = lambda script, *more: str(["sh", "-c", script, str(directory), *more]).replace("'", '"')
    on, off = "echo $1 > $0/power; echo on $1 >> $0/history", "echo off > $0/power; echo off >> $0/history"
    file = directory / "radio.toml"
    file.write_text(
        f'[radio]\nsystem_id = {SYSTEM}\n[link]\naddress = "udpin:127.0.0.1:{port}"\nkey_file = "radio.key"\n'
        f'[device]\nkind = "command"\nleast = 0\nmost = 27\noff_ms = 1500\nchange_ms = 1500\ndead_ms = 400\n'
        f"[command]\nset = {sh(on, '{dbm}')}\nread = {sh('cat $0/power')}\noff = {sh(off)}\n"
        f'read_off = {sh("cat $0/power")}\noff_reads = "off"\n[log]\ndir = "{directory}/logs"\n'
    )
    return file


def history(directory):
    path = directory / "history"
    return path.read_text().split("\n")[:-1] if path.exists() else []


def commands(port, directory):
    us = Commander(port)
    beat = us.awaited("HEARTBEAT", lambda m: m.get_srcComponent() == RADIO)
    check(beat.type == mav.MAV_TYPE_RADIO if hasattr(mav, "MAV_TYPE_RADIO") else True, f"HEARTBEAT of type {beat.type}")
    first = us.report()
    check(first.power_mdbm == OFF and first.boot == 0, "off before anybody commands")
    check(history(directory)[0] == "off", "off is the first thing that the device was told")
    count = sum(m.get_type() == "VEILWING_RADIO" for m in us.hear(2.0))
    check(count >= 10, f"{count} reports in 2 s, unasked")

    before = us.series
    answer = us.give(-math.inf, 0)
    check(RESULTS[answer.result] == "ACCEPTED" and answer.power_mdbm == OFF, "off, number 1: ACCEPTED")
    check(answer.series != before and answer.boot == us.boot, "a new series with our boot")
    answer = us.give(20.7, 4000)
    check((RESULTS[answer.result], answer.power_mdbm) == ("ACCEPTED", 20_000), "20.7 dBm is 20 dBm: rounded down")
    check(history(directory)[-1] == "on 20", "the device was told 20 dBm")
    expires = answer.expires_ms
    off = us.awaited("VEILWING_RADIO", lambda m: m.power_mdbm == OFF)
    late = (off.time_ms - expires) % 2**32
    late = late - 2**32 if late >= 2**31 else late
    check(-21 - 150 <= late <= 1500 + 200, f"off by itself: reported {late} ms after the expiry, on its own clock")
    check(history(directory)[-1] == "off", "the device was told off")

    for dbm, ahead_ms, fields, wanted in [
        (10.0, 4000, {"number": 1}, "NOT_NEWER"),
        (10.0, 4000, {"boot": 99, "series": 1}, "OTHER_SERIES"),
        (10.0, -100, {}, "EXPIRED"),
        (10.0, 6000, {}, "DENIED"),
        (27.5, 4000, {}, "DENIED"),
        (math.nan, 4000, {}, "DENIED"),
        (-3.0, 4000, {}, "TOO_LOW"),
        (10.0, 4000, {}, "ACCEPTED"),
    ]:
        us.report()
        got = us.result(dbm, ahead_ms, **fields)
        check(got == wanted, f"{dbm} dBm for {ahead_ms} ms {fields}: {got}")

    declared = {}
    us.send(mav.MAVLink_param_request_list_message(SYSTEM, RADIO))
    for message in us.hear(1.0):
        if message.get_type() == "PARAM_VALUE":
            declared[message.param_id] = message.param_value
    expected = {"TX_MAX_DBM": 27, "TX_MIN_DBM": 0, "TX_OFF_MS": 1500, "TX_CHANGE_MS": 1500, "TX_READ_BACK": 1}
    expected |= {"TX_DEAD_MS": 400, "TX_BAND_LO_KHZ": -1, "TX_BAND_HI_KHZ": -1}
    check(declared == expected, f"declares {declared}")
    return us


def forgeries(us, port, directory):
    """What others say, while we hold 10 dBm; the device's history before and after."""
    us.report()
    check(us.result(10.0, 4900) == "ACCEPTED", "we hold 10 dBm")
    before = history(directory)
    unsigned, wrong = Commander(port, key=None), Commander(port, key=bytes(32))
    replayed = list(us.frames)
    frames = {"unsigned": [], "wrong_signature": [], "replayed": replayed}
    for name, forger in (("unsigned", unsigned), ("wrong_signature", wrong)):
        forger.number, forger.series, forger.time_ms = us.number, us.series, us.time_ms
        kill = mav.MAVLink_command_long_message(0, 0, KILL, 0, 0, 0, 0, 0, 0, 0, 0)
        frames[name] = [forger.power(25.0, 4000).pack(forger.mav) for _ in range(20)] + [kill.pack(forger.mav)]
    # From an address of their own, and as if from ours.
    for frame in sum(frames.values(), []):
        unsigned.socket.sendto(frame, us.to)
        us.socket.sendto(frame, us.to)
    check(not list(unsigned.hear(0.5)), "whoever cannot sign is not answered")
    us.report()
    answer = us.give(10.0, 4000)
    check((RESULTS[answer.result], answer.power_mdbm) == ("ACCEPTED", 10_000), "and ours goes on")
    sent = {name: len(those) for name, those in frames.items()}
    check(history(directory) == before, f"{2 * sum(sent.values())} such frames: the device heard nothing")
    return sent


def kill(us, directory):
    us.send(mav.MAVLink_command_long_message(0, 0, KILL, 0, 0, 0, 0, 0, 0, 0, 0))
    us.awaited("VEILWING_RADIO", lambda m: m.power_mdbm == OFF)
    check(history(directory)[-1] == "off", "a radio kill that is said to all is off")
    check(us.result(10.0, 4000) == "NOT_NOW", "and holds")
    us.send(mav.MAVLink_command_long_message(SYSTEM, RADIO, KILL, 0, 1, 0, 0, 0, 0, 0, 0))
    us.awaited("COMMAND_ACK", lambda m: (m.command, m.result) == (KILL, 0))
    us.report()
    check(us.result(10.0, 4000) == "ACCEPTED", "lifted here, it is over")


def program(arguments):
    add_definition(arguments.definitions)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        directory = pathlib.Path(name)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        with open(directory / "stderr", "w+") as stderr:
            radio = subprocess.Popen(
                [arguments.program, "radio", radio_file(directory, port)], stdin=subprocess.DEVNULL, stderr=stderr
            )
            try:
                us = commands(port, directory)
                sent = forgeries(us, port, directory)
                kill(us, directory)
                radio.send_signal(signal.SIGTERM)
                check(radio.wait(10) == 130 and history(directory)[-1] == "off", "SIGTERM: off, and exit code 130")
            finally:
                radio.kill()
                radio.wait()
                log = (directory / "stderr").read_text()
        counted = re.search(r"link: (.*)", log)
        check(counted is not None, "the log counts what was turned away")
        words = re.sub(r"\x1b\[[0-9;]*m", "", counted.group(1))
        numbers = {name: int(n) for name, n in re.findall(r"\b([a-z_]+) (\d+)(?:,|$)", words)}
        # What is older than any clock may be is told apart from what has been heard before.
        numbers["replayed"] = numbers.get("replayed", 0) + numbers.get("too_old", 0)
        print(f"{'as if from us':<22}{'sent':>6}{'counted':>9}")
        for name, count in sent.items():
            print(f"{name:<22}{count:>6}{numbers.get(name, 0):>9}", flush=True)
        elsewhere = numbers.get("stranger", 0)
        print(f"{'from elsewhere':<22}{sum(sent.values()):>6}{elsewhere:>9}")
        enough = all(numbers.get(name, 0) >= count for name, count in sent.items())
        check(enough and elsewhere >= sum(sent.values()), "each of them is counted")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True)
    parser.add_argument("--definitions", required=True)
    given = parser.parse_args()
    run(lambda: program(given), 120.0)
