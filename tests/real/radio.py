#!/usr/bin/env python3
"""Independent leased transmitter: component 68 beside an autopilot, for `veilwing` ([transmitter] kind = "leased"), both forms.

Written from the project's docs/radio.md alone. Form 2: COMMAND_INT 31010, param1 dBm, param2 number, param3 boot, param4 series, x slot, y expiry on this
radio's clock; answered by VEILWING_RADIO (42120) inside TUNNEL. Form 1 (param2 = 0): y in ms from receipt, COMMAND_ACK.
usage: radio.py --instance N --log FILE [--max-dbm D] [--port P --dest P] [--limit] [--ack-loss P]
Log lines: JSON {t: wall, on: bool, dbm, slot, why}.
"""

from pymavlink.generator.mavcrc import x25crc
from pymavlink.dialects.v20 import common as mav
import argparse
import json
import math
import os
import random
import select
import socket
import struct
import sys
import time


ap = argparse.ArgumentParser()
ap.add_argument("--instance", type=int, default=0)
ap.add_argument("--system", type=int, default=0)
ap.add_argument("--component", type=int, default=68)
ap.add_argument("--port", type=int, default=0, help="UDP port that PX4 sends its payload link to (14030+instance)")
ap.add_argument("--dest", type=int, default=0)
ap.add_argument("--max-dbm", type=float, default=27.0)
ap.add_argument("--log", required=True)
ap.add_argument("--limit", action="store_true", help="answer PARAM_REQUEST_READ of TX_MAX_DBM")
ap.add_argument("--ack-loss", type=float, default=0.0)
A = ap.parse_args()
SYS = A.system or A.instance + 1
port = A.port or 14030 + A.instance
dest = ("127.0.0.1", A.dest or 14280 + A.instance)
OFF = -(2**31)
FIELDS = [
    "uint32_t time_ms",
    "uint32_t boot",
    "uint32_t newest",
    "uint32_t answers_boot",
    "uint32_t answers",
    "uint32_t series",
    "uint32_t expires_ms",
    "int32_t power_mdbm",
    "uint8_t result",
]
c = x25crc(b"VEILWING_RADIO ")
for f in FIELDS:
    c.accumulate((f + " ").encode())
EXTRA = (c.crc & 0xFF) ^ (c.crc >> 8)
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("127.0.0.1", port))
s.setblocking(False)
ml = mav.MAVLink(None, SYS, A.component)
ml.robust_parsing = True
rxp = mav.MAVLink(None, SYS, A.component)
rxp.robust_parsing = True
log = open(A.log, "a", buffering=1)
clock0 = random.randrange(2**32)  # the radio's clock: any


def clock():
    return int(clock0 + (time.monotonic() - born) * 1e3) % 2**32


def note(**k):
    log.write(json.dumps(dict(t=time.time(), **k)) + "\n")


def send(m):
    try:
        s.sendto(m.pack(ml), dest)
    except OSError:
        pass
    ml.seq = (ml.seq + 1) % 256


born = time.monotonic()
on_dbm, slot, until = None, 0, None
boot = newest = 0
series = random.randrange(1, 2**24)
commander = None
expires = 0
form1 = True
seq = 0
note(start=True, system=SYS, extra=EXTRA)


def report(ab=0, an=0, result=0):
    global seq
    p = struct.pack(
        "<7IiB",
        clock(),
        boot,
        newest,
        ab,
        an,
        series,
        expires,
        OFF if on_dbm is None else int(round(on_dbm * 1000)),
        result,
    )
    p = p.rstrip(b"\0") or b"\0"
    h = struct.pack("<BBBBBBBHB", 0xFD, len(p), 0, 0, seq, SYS, A.component, 42120 & 0xFFFF, 42120 >> 16)
    seq = (seq + 1) % 256
    c = x25crc(h[1:])
    c.accumulate(p)
    c.accumulate(bytes([EXTRA]))
    f = h + p + struct.pack("<H", c.crc)
    if random.random() >= A.ack_loss:
        send(mav.MAVLink_tunnel_message(0, 0, 42120, len(f), list(f) + [0] * (128 - len(f))))


def off(why, **k):
    global on_dbm, until
    if on_dbm is not None:
        note(on=False, why=why, **k)
    on_dbm = until = None


def turn_on(p, x, end, **k):
    global on_dbm, slot, until
    got = math.floor(min(p, A.max_dbm) * 1000) / 1000
    if on_dbm is None:
        note(on=True, dbm=got, slot=x, asked=p, **k)
    elif got != on_dbm or x != slot:
        note(on=True, dbm=got, slot=x, asked=p, why="changed", **k)
    on_dbm, slot, until = got, x, end
    return int(round(got * 1000))


def numbered(m):
    global boot, newest, series, expires, form1, commander
    n, b, ser = int(m.param2), int(m.param3), int(m.param4)
    who = (m.get_srcSystem(), m.get_srcComponent())
    if who[0] != SYS or (commander and who != commander):
        return
    commander = who
    form1 = False
    if b != boot:
        if ser != series:
            return report(b, n, 2)
        off("new boot")
        boot, newest, series = b, 0, random.randrange(1, 2**24)
    if n <= newest:
        return report(b, n, 1)
    newest = n
    if m.param1 == -math.inf:
        off("commanded")
        return report(b, n, 0)
    ahead = ((m.y - clock()) + 2**31) % 2**32 - 2**31
    if ahead <= 0:
        off("expired on arrival")
        return report(b, n, 3)
    if ahead > 5000 or not math.isfinite(m.param1) or m.param1 > A.max_dbm:
        return report(b, n, 4)
    turn_on(m.param1, m.x, time.monotonic() + ahead / 1e3, ms=ahead)
    expires = m.y % 2**32
    report(b, n, 0)


next_hb = next_report = 0.0
while True:
    now = time.monotonic()
    if until is not None and now >= until:
        off("expired", late_ms=round((now - until) * 1e3, 1))
    if now >= next_hb:
        next_hb = now + 1.0
        send(ml.heartbeat_encode(29, mav.MAV_AUTOPILOT_INVALID, 0, 0, mav.MAV_STATE_ACTIVE))
    if now >= next_report:
        next_report = now + 0.2
        report()
    w = min([next_hb, next_report] + ([until] if until is not None else [])) - time.monotonic()
    r, _, _ = select.select([s], [], [], max(0.0, w))
    if not r:
        continue
    try:
        data, addr = s.recvfrom(65535)
    except OSError:
        continue
    dest = addr
    for m in rxp.parse_buffer(data) or []:
        t = m.get_type()
        if t == "COMMAND_INT" and m.command == 31010 and m.target_system == SYS and m.target_component == A.component:
            if m.param2 != 0:
                numbered(m)
                continue
            if not form1:
                continue
            if m.y > 0 and math.isfinite(m.param1):
                res = turn_on(m.param1, m.x, time.monotonic() + m.y / 1e3, ms=m.y)
            else:
                off("commanded")
                res = OFF
            if random.random() >= A.ack_loss:
                send(ml.command_ack_encode(31010, 0, 0, res, m.get_srcSystem(), m.get_srcComponent()))
        elif t == "PARAM_REQUEST_READ" and m.target_component == A.component and A.limit:
            send(ml.param_value_encode(b"TX_MAX_DBM", A.max_dbm, 9, 1, 0))
