#!/usr/bin/env python3
"""A pair of real PX4s (8-rotor omnicopter, omni_hil.py) flown by two `veilwing fly`, with independent transmitters.

Environment: PX4 (source tree, built), VEILWING (the program), RUN (a folder for runs), MAVLINK20=1; run.sh sets all but the
first. The mission is flown about PX4's usual place, whatever its own origin.
usage: pair.py NAME [options] [--do 'TRIGGER=>ACTION']...
A TRIGGER is ROLE@REGEX[+SECONDS] (a line of that companion's log) or t+SECONDS (from MISSION_START); an ACTION one of
  kill i|j   stop i|j SECONDS   cut i|j SECONDS   delay i|j S [JITTER]   loss i|j P   rate i|j BYTES_S   mode i|j MAIN SUB
  cmd i|j COMMAND [P1]   term i|j   txkill i|j   px4kill i|j   param i|j NAME VALUE   start   restart i|j   end
Leaves RUN/NAME: i/, j/ (companion logs, truth.csv, px4.log), tx-i.log, tx-j.log, gcs.log, mission.toml, setup.json,
end.json; then score.py RUN/NAME.
"""

import geo
from pymavlink.dialects.v20 import common as mav
from pymavlink import mavutil
import argparse
import json
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
mavutil.set_dialect("common")
MAIN = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 10: "TERMINATION"}
AUTO = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW", 9: "PRECLAND"}


def mode_name(custom):
    main, sub = (custom >> 16) & 0xFF, (custom >> 24) & 0xFF
    return MAIN.get(main, str(main)) + ("." + AUTO.get(sub, str(sub)) if main == 4 else "")


ap = argparse.ArgumentParser()
ap.add_argument("name")
ap.add_argument("--mission", required=True)
ap.add_argument("--origin", type=float, nargs=3, default=[47.397742, 8.545594, 488.0])
ap.add_argument("--home-i", type=float, nargs=3, default=[-15.0, -10.0, 0.0])
ap.add_argument("--home-j", type=float, nargs=3, default=[-10.0, -60.0, 0.0])
ap.add_argument("--yaw-i", type=float, default=0.0)
ap.add_argument("--yaw-j", type=float, default=0.0)
ap.add_argument("--wind", type=float, nargs=3, default=[0, 0, 0])
ap.add_argument("--gust", type=float, default=0.0)
ap.add_argument("--noise", type=float, default=1.0)
ap.add_argument("--gyro-noise", type=float, default=0.002)
ap.add_argument("--ground-shake", type=float, default=0.0)
ap.add_argument("--set", nargs="*", default=[], help="PX4 parameters to set before the companions start: NAME=VALUE")
ap.add_argument("--firmware", default="px4")
ap.add_argument("--actuation", default="thrust_vector")
ap.add_argument("--autopilot-extra", default="", help="lines for [autopilot], separated by ;")
ap.add_argument("--tx-extra", default="", help="lines for [transmitter]")
ap.add_argument("--start", choices=["gcs", "flag", "none"], default="gcs")
ap.add_argument("--late", type=float, default=0.0, help="seconds that PX4 has run before the companions start")
ap.add_argument("--gate", action="store_true", help="put gate.py between PX4 and companions")
ap.add_argument("--calm", action="store_true", help="gate.py --calm")
ap.add_argument("--do", action="append", default=[])
ap.add_argument("--timeout", type=float, default=240)
ap.add_argument("--missions", type=int, default=1, help="fly that many missions, companions restarted, PX4 not")
ap.add_argument(
    "--keep", action="store_true", help="leave the PX4s flying after the companions end until on the ground (60 s)"
)
ap.add_argument("--gcs-heartbeat", action="store_true")
A = ap.parse_args()

PX4, RUN, VEIL = os.environ["PX4"], os.environ["RUN"], os.environ["VEILWING"]
PY = sys.executable
D = os.path.join(RUN, A.name)
subprocess.run(["rm", "-rf", D])
os.makedirs(D)
ROLES = ["i", "j"]
procs = {}
homes = {r: [float(x) for x in geo.from_enu(h, A.origin)] for r, h in (("i", A.home_i), ("j", A.home_j))}
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
T0 = time.time()


def short_slices():
    """Normal priority, but a short slice (EEVDF, Linux 6.12): on a busy machine a flight is run soon, not more."""
    import ctypes
    import struct

    try:
        a = ctypes.create_string_buffer(struct.pack("IIQiIQQQII", 56, 0, 0, 0, 0, 100000, 0, 0, 0, 0), 56)
        r = ctypes.CDLL(None, use_errno=True).syscall(314, 0, a, 0)
        return r == 0 or ctypes.get_errno()
    except Exception as e:
        return e


SLICES = short_slices()


def say(*a):
    print("[%7.2f]" % (time.time() - T0), *a, flush=True)


def spawn(key, cmd, out, cwd=None, env=None):
    f = open(out, "ab")
    p = subprocess.Popen(
        cmd, stdout=f, stderr=subprocess.STDOUT, cwd=cwd, env=env, stdin=subprocess.DEVNULL, start_new_session=True
    )
    procs[key] = p
    return p


def start_px4(r):
    k = ROLES.index(r)
    d = os.path.join(D, r)
    os.makedirs(d, exist_ok=True)
    B = PX4 + "/build/px4_sitl_default"
    h = homes[r]
    env = dict(os.environ)
    spawn(
        "sim-" + r,
        [
            PY,
            HERE + "/omni_hil.py",
            "--instance",
            str(k),
            "--csv",
            d + "/truth.csv",
            "--lat",
            repr(h[0]),
            "--lon",
            repr(h[1]),
            "--alt",
            repr(h[2]),
            "--yaw",
            str(A.yaw_i if r == "i" else A.yaw_j),
            "--noise",
            str(A.noise),
            "--gust",
            str(A.gust),
            "--gyro-noise",
            str(A.gyro_noise),
            "--ground-shake",
            str(A.ground_shake),
            "--seed",
            str(k + 1),
            "--wind",
            *map(str, A.wind),
        ],
        d + "/sim.log",
    )
    env.update(PX4_SYS_AUTOSTART="10019", PX4_SIM_MODEL="gazebo-classic_omnicopter", PX4_SIMULATOR="mavlink")
    # PX4 sources px4-rc.params from where PATH finds it first.
    env["PATH"] = HERE + "/params:" + env["PATH"]
    w = d + "/px4"
    os.makedirs(w, exist_ok=True)
    spawn("px4-" + r, [B + "/bin/px4", "-i", str(k), "-d", B + "/etc"], d + "/px4.log", cwd=w, env=env)


def vehicle_file(r):
    k = ROLES.index(r)
    port = (24540 if A.gate else 14540) + k
    pair = "udpout:127.0.0.1:14601" if r == "i" else "udpin:127.0.0.1:14601"
    open(f"{D}/vehicle-{r}.toml", "w").write(f"""[vehicle]
role = "{r}"
[autopilot]
link = "udpin:127.0.0.1:{port}"
firmware = "{A.firmware}"
actuation = "{A.actuation}"
system_id = {k + 1}
{A.autopilot_extra.replace(';', chr(10))}
[transmitter]
kind = "leased"
simulated = true
{A.tx_extra.replace(';', chr(10))}
[pair]
link = "{pair}"
[log]
dir = "{D}/{r}/flight-logs"
""")


def start_companion(r, n=0):
    cmd = [VEIL, "fly", D + "/mission.toml", "--vehicle", f"{D}/vehicle-{r}.toml"] + (
        ["--start"] if A.start == "flag" else []
    )
    env = dict(os.environ, RUST_LOG=os.environ.get("RUST_LOG", "info"), NO_COLOR="1")
    logs[r] = f'{D}/{r}/companion{n or ""}.log'
    spawn("veil-" + r, cmd, logs[r], cwd=D, env=env)
    threading.Thread(target=tail, args=(r, logs[r], procs["veil-" + r]), daemon=True).start()


lines = []  # (wall, role, text)
logs = {}


def tail(r, path, p):
    with open(path, errors="replace") as f:
        buf = ""
        while True:
            x = f.readline()
            if x:
                buf += x
                if buf.endswith("\n"):
                    t = re.sub(r"\x1b\[[0-9;]*m", "", buf.rstrip())
                    buf = ""
                    lines.append((time.time(), r, t))
                    say(r.upper(), "|", t[:230])
            elif p.poll() is not None and not f.readline():
                return
            else:
                time.sleep(0.02)


class Gcs(threading.Thread):
    def __init__(s):
        super().__init__(daemon=True)
        s.m = mavutil.mavlink_connection(
            "udpin:127.0.0.1:14550", source_system=255, source_component=190, dialect="common"
        )
        s.last = {}
        s.f = open(D + "/gcs.log", "a", buffering=1)
        s.modes = {}
        s.params = {}
        s.land = {}
        s.lock = threading.Lock()

    def run(s):
        hb = 0
        while True:
            try:
                m = s.m.recv_match(blocking=True, timeout=0.2)
            except Exception as e:
                continue
            if A.gcs_heartbeat and time.time() > hb:
                hb = time.time() + 1
                s.m.mav.heartbeat_send(6, 8, 0, 0, 4)
            if m is None:
                continue
            t, src = m.get_type(), (m.get_srcSystem(), m.get_srcComponent())
            if t == "BAD_DATA":
                continue
            s.last[src + (t,)] = m
            if t == "STATUSTEXT":
                s.note("text", src, m.severity, m.text)
                (src[1] == 1) and say("PX4-%s %s" % (ROLES[src[0] - 1] if src[0] in (1, 2) else src, m.text))
            elif t == "HEARTBEAT" and src[1] == 1:
                x = (mode_name(m.custom_mode), bool(m.base_mode & 128))
                if s.modes.get(src) != x:
                    s.modes[src] = x
                    s.note("mode", src, *x)
                    say("PX4-%s MODE %s %s" % (ROLES[src[0] - 1], x[0], "armed" if x[1] else "disarmed"))
            elif t == "EXTENDED_SYS_STATE":
                if s.land.get(src) != m.landed_state:
                    s.land[src] = m.landed_state
                    s.note("landed", src, m.landed_state)
            elif t == "COMMAND_ACK":
                s.note("ack", src, m.command, m.result, m.target_system, m.target_component)
            elif t == "PARAM_VALUE":
                v = m.param_value
                if m.param_type == 6:
                    v = struct.unpack("<i", struct.pack("<f", v))[0]
                s.params[(src[0], m.param_id)] = v
            elif t == "NAMED_VALUE_FLOAT" and src[1] != 1:
                s.note("named", src, m.name, m.value)

    def note(s, *a):
        s.f.write(json.dumps([time.time(), *a]) + "\n")

    def get(s, sysid, name):
        for _ in range(6):
            s.params.pop((sysid, name), None)
            s.m.mav.param_request_read_send(sysid, 1, name.encode(), -1)
            e = time.time() + 0.7
            while time.time() < e:
                if (sysid, name) in s.params:
                    return s.params[(sysid, name)]
                time.sleep(0.02)

    def set(s, sysid, name, value):
        cur = s.get(sysid, name)
        i = isinstance(cur, int)
        v = struct.unpack("<f", struct.pack("<i", int(value)))[0] if i else float(value)
        for _ in range(5):
            s.m.mav.param_set_send(sysid, 1, name.encode(), v, 6 if i else 9)
            time.sleep(0.3)
            if s.get(sysid, name) is not None and abs(s.params[(sysid, name)] - value) < 1e-6:
                break
        say("param", sysid, name, cur, "->", s.params.get((sysid, name)))

    def cmd(s, sysid, comp, c, *p):
        p = (list(p) + [0] * 7)[:7]
        s.note("cmd", sysid, comp, c, p)
        s.m.mav.command_long_send(sysid, comp, c, 0, *p)


def ctl(r, text):
    import socket

    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(text.encode(), ("127.0.0.1", 4800 + ROLES.index(r)))


events = []  # what was done: wall, text


def act(a):
    k = a.split()
    say("=== DO", a)
    events.append((time.time(), a))
    g.note("do", a)
    if k[0] == "kill":
        procs["veil-" + k[1]].kill()
    elif k[0] == "cont":
        procs["veil-" + k[1]].send_signal(signal.SIGCONT)
    elif k[0] == "term":
        procs["veil-" + k[1]].terminate()
    elif k[0] == "stop":
        p = procs["veil-" + k[1]]
        p.send_signal(signal.SIGSTOP)
        todo.append(["", "cont " + k[1], time.time() + float(k[2])])
    elif k[0] in ("cut", "delay", "loss", "rate"):
        ctl(k[1], " ".join([k[0]] + k[2:]))
    elif k[0] == "mode":
        g.cmd(ROLES.index(k[1]) + 1, 1, 176, 1, float(k[2]), float(k[3]) if len(k) > 3 else 0)
    elif k[0] == "cmd":
        g.cmd(ROLES.index(k[1]) + 1, 191, int(k[2]), *map(float, k[3:]))
    elif k[0] == "px4cmd":
        g.cmd(ROLES.index(k[1]) + 1, 1, int(k[2]), *map(float, k[3:]))
    elif k[0] == "txkill":
        procs["tx-" + k[1]].kill()
    elif k[0] == "px4kill":
        procs["px4-" + k[1]].kill()
    elif k[0] == "param":
        g.set(ROLES.index(k[1]) + 1, k[2], float(k[3]))
    elif k[0] == "get":
        say("param", k[1], k[2], "=", g.get(ROLES.index(k[1]) + 1, k[2]))
    elif k[0] == "restart":
        start_companion(k[1], 9)
    elif k[0] == "start":
        g.cmd(1, 191, 300)
    elif k[0] == "end":
        global ended
        ended = True


ended = False
exits = []  # of the two companions, by mission
todo = []
for d in A.do:
    trig, a = d.split("=>", 1)
    todo.append([trig, a, None])
t_start = None
seen = 0


def triggers():
    global seen
    new = lines[seen:]
    seen += len(new)
    for x in todo:
        if x[1] is None:
            continue
        if x[2] is None:
            if x[0].startswith("t+"):
                if t_start:
                    x[2] = t_start + float(x[0][2:])
            else:
                r, rest = x[0].split("@", 1)
                m = re.match(r"(.*?)(?:\+([\d.]+))?$", rest)
                for w, who, text in new:
                    if who == r and re.search(m.group(1), text):
                        x[2] = time.time() + float(m.group(2) or 0)
                        break
        if x[2] is not None and time.time() >= x[2]:
            a, x[1] = x[1], None
            for one in a.split("&"):
                act(one.strip())


def stop_all():
    for k in list(procs):
        p = procs[k]
        if p.poll() is None:
            try:
                p.send_signal(signal.SIGCONT)
            except Exception:
                pass
            (p.kill if k.startswith("px4") else p.terminate)()
    time.sleep(0.5)
    for p in procs.values():
        if p.poll() is None:
            p.kill()


try:
    origin = "origin = { lat_deg = %r, lon_deg = %r, alt_amsl_m = %r }" % tuple(A.origin)
    with open(A.mission) as f:
        text = re.sub(r"(?m)^origin = .*$", origin, f.read(), count=1)
    with open(D + "/mission.toml", "w") as f:
        f.write(text)
    g = Gcs()
    g.start()
    for r in ROLES:
        start_px4(r)
    json.dump(dict(origin=A.origin, homes=homes, args=vars(A)), open(D + "/setup.json", "w"))
    end = time.time() + 60
    while time.time() < end and len([1 for k in g.modes if k[1] == 1]) < 2:
        time.sleep(0.1)
    say("heartbeats", g.modes)
    for r in ROLES:
        for sv in A.set:
            n, v = sv.split("=")
            g.set(ROLES.index(r) + 1, n, float(v))
    for r in ROLES:
        k = ROLES.index(r)
        if A.gate:
            spawn(
                "gate-" + r,
                [PY, HERE + "/gate.py", "--instance", str(k)] + (["--calm"] if A.calm else []),
                f"{D}/{r}/gate.log",
            )
        spawn("tx-" + r, [PY, HERE + "/radio.py", "--instance", str(k), "--log", f"{D}/tx-{r}.log"], f"{D}/{r}/tx.out")
        vehicle_file(r)
    time.sleep(A.late)
    for n in range(A.missions):
        if n:
            say("======== mission", n + 1)
        base = len(lines)
        for r in ROLES:
            start_companion(r, n)
        end = time.time() + A.timeout
        asked = A.start != "gcs"
        t_begin = time.time()
        while time.time() < end and not ended:
            time.sleep(0.02)
            triggers()
            if not asked:
                both = all(
                    any(w == r and re.search(r"waiting: MISSION_START( role|$)", t) for _, w, t in lines[base:])
                    for r in ROLES
                )
                if both:
                    asked = True
                    t_start = time.time()
                    say("MISSION_START", "after %.1f s" % (t_start - t_begin))
                    g.cmd(1, 191, 300)
            if all(procs["veil-" + r].poll() is not None for r in ROLES):
                break
        exits.append({r: procs["veil-" + r].poll() for r in ROLES})
        say("exit codes", exits[-1])
        if A.keep or n + 1 < A.missions:
            e = time.time() + 90
            while time.time() < e and any(x[1] for k, x in g.modes.items()):
                time.sleep(0.1)
                triggers()
        for k_, p_ in procs.items():
            try:
                x_ = open(f"/proc/{p_.pid}/stat").read().rsplit(") ", 1)[1].split()
                say("cpu", k_, round((int(x_[11]) + int(x_[12])) / 100, 1), "s of", round(time.time() - T0, 1))
            except Exception:
                pass
        say("PX4 modes at end", g.modes, "landed", g.land)
    guard = [g.get(k + 1, "LNDMC_Z_VEL_MAX") for k in (0, 1)]
    say("LNDMC_Z_VEL_MAX", guard)
    armed = [g.modes.get((k + 1, 1), ("", True))[1] for k in (0, 1)]
    json.dump(dict(exits=exits, guard=guard, armed=armed), open(D + "/end.json", "w"))
    json.dump(events, open(D + "/events.json", "w"))
finally:
    stop_all()
    for r in ROLES:
        try:
            say("sim", r, os.popen(f"tail -n 1 {D}/{r}/sim.log").read().strip())
        except Exception:
            pass
