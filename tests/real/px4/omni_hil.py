#!/usr/bin/env python3
"""Lockstep MAVLink-HIL simulator of PX4's 8-rotor omnicopter (airframe 10019_gazebo-classic_omnicopter).

TCP server on 4560+instance (PX4's simulator_mavlink connects to it). Each 4 ms step: integrate the rigid body
(semi-implicit, --substeps), send HIL_SENSOR (id 0), then wait for HIL_ACTUATOR_CONTROLS (lockstep).
Rotor positions/axes/KM come from the airframe file's CA_ROTOR* lines; mass/inertia/motor constants from
PX4-SITL_gazebo-classic models/omnicopter/omnicopter.sdf (1.5+0.015+8*0.005+0.015 kg, I=0.0852, k=2.50972e-5,
1000 rad/s per unit control, tau up/down 12.5/25 ms, reversible).
Frames: NED world, FRD body. Truth goes out as JSON on UDP 127.0.0.1:4700+instance (50 Hz of sim time) and to a CSV.
"""

from pymavlink.dialects.v20 import common as mav
import numpy as np
import argparse
import json
import math
import os
import re
import select
import socket
import sys
import time


ap = argparse.ArgumentParser()
ap.add_argument("--instance", type=int, default=0)
ap.add_argument(
    "--airframe",
    default=os.environ["PX4"] + "/ROMFS/px4fmu_common/init.d-posix/airframes/10019_gazebo-classic_omnicopter",
)
ap.add_argument("--speed", type=float, default=1.0, help="real-time factor, 0 = as fast as possible")
ap.add_argument("--dt", type=float, default=0.004)
ap.add_argument("--substeps", type=int, default=4)
ap.add_argument("--thrust-model", choices=["quadratic", "linear"], default="quadratic")
ap.add_argument("--mass", type=float, default=1.57)
ap.add_argument("--inertia", type=float, default=0.0855)
ap.add_argument("--fmax", type=float, default=2.50972e-5 * 1000.0**2, help="N per rotor at control 1")
ap.add_argument("--drag", type=float, default=0.1, help="N/(m/s), isotropic")
ap.add_argument("--wind", type=float, nargs=3, default=[0, 0, 0], help="NED m/s")
ap.add_argument("--noise", type=float, default=1.0, help="sensor noise scale")
ap.add_argument(
    "--gyro-noise",
    type=float,
    default=0.002,
    help="rad/s; above 0.008 PX4 never calls the vehicle at rest (LandDetector.cpp GYRO_VIBE_METRIC_MAX)",
)
ap.add_argument(
    "--ground-shake",
    type=float,
    default=0.0,
    help="gyro noise rad/s while standing: a vehicle that PX4 does not call at rest",
)
ap.add_argument("--lat", type=float, default=47.397742)
ap.add_argument("--lon", type=float, default=8.545594)
ap.add_argument("--alt", type=float, default=488.0)
ap.add_argument("--yaw", type=float, default=0.0, help="initial heading deg")
ap.add_argument("--seed", type=int, default=1)
ap.add_argument("--csv", default="")
ap.add_argument("--decl", type=float, default=3.4057, help="magnetic declination deg (WMM at the place)")
ap.add_argument("--incl", type=float, default=63.157)
ap.add_argument("--gust", type=float, default=0.0, help="std of a first-order (2 s) gust on each axis, m/s")
A = ap.parse_args()

# ---------------------------------------------------------------- airframe
txt = open(A.airframe).read()
par = {k: float(v) for k, v in re.findall(r"^param set-default (?:-s )?(\w+)\s+(-?[\d.]+)", txt, re.M)}
N = int(par["CA_ROTOR_COUNT"])
P = np.array([[par["CA_ROTOR%d_P%s" % (i, a)] for a in "XYZ"] for i in range(N)])
AX = np.array([[par["CA_ROTOR%d_A%s" % (i, a)] for a in "XYZ"] for i in range(N)])
AX /= np.linalg.norm(AX, axis=1)[:, None]
KM = np.array([par["CA_ROTOR%d_KM" % i] for i in range(N)])
REV = int(par.get("CA_R_REV", 0))
W = np.vstack([AX.T, (np.cross(P, AX) - KM[:, None] * AX).T])  # 6 x N: force, moment per newton of rotor thrust
print(
    "omni_hil: %d rotors, fmax %.2f N, mass %.3f kg, max Fz %.1f N, rank %d, cond %.2f"
    % (N, A.fmax, A.mass, np.abs(AX[:, 2]).sum() * A.fmax, np.linalg.matrix_rank(W), np.linalg.cond(W)),
    flush=True,
)

WL = W.T.tolist()
rng = np.random.default_rng(A.seed)
G = 9.80665
R_E = 6371000.0
DEC, INC, BTOT = math.radians(A.decl), math.radians(A.incl), 0.48238  # PX4 WMM tables at the default location, gauss
B_NED = BTOT * np.array([math.cos(INC) * math.cos(DEC), math.cos(INC) * math.sin(DEC), math.sin(INC)])
wind = np.array(A.wind, float)
gust = np.zeros(3)


def q2R(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Body:
    def __init__(s):
        s.p = np.zeros(3)
        s.v = np.zeros(3)
        h = math.radians(A.yaw) / 2
        s.q = np.array([math.cos(h), 0, 0, math.sin(h)])
        s.R = q2R(s.q)
        s.w = np.zeros(3)
        # rotor state (signed rotor speed fraction, or thrust fraction in the linear model)
        s.u = np.zeros(N)
        s.f_spec = np.array([0, 0, -G])
        s.on_ground = True
        s.impact = 0.0

    def step(s, cmd, dt, n):
        """n substeps of dt/n under the command."""
        h = dt / n
        exp = math.exp
        up, dn = 1 - exp(-h / 0.0125), 1 - exp(-h / 0.025)  # gazebo_motor_model: speeding up, slowing down
        quad, fmax, I, rI = A.thrust_model == "quadratic", A.fmax, A.inertia, 1.0 / A.mass
        px, py, pz = s.p.tolist()
        vx, vy, vz = s.v.tolist()
        q0, q1, q2, q3 = s.q.tolist()
        wx, wy, wz = s.w.tolist()
        u = s.u.tolist()
        c = cmd.tolist()
        W6 = WL
        wn = wind.tolist()
        ax = ay = az = 0.0
        gr = s.on_ground
        for _ in range(n):
            f0 = f1 = f2 = m0 = m1 = m2 = 0.0
            for i in range(N):
                ci, ui = c[i], u[i]
                ui += (ci - ui) * (up if abs(ci) > abs(ui) else dn)
                u[i] = ui
                f = fmax * (ui * abs(ui) if quad else ui)
                k = W6[i]
                f0 += k[0] * f
                f1 += k[1] * f
                f2 += k[2] * f
                m0 += k[3] * f
                m1 += k[4] * f
                m2 += k[5] * f
            r00 = 1 - 2 * (q2 * q2 + q3 * q3)
            r01 = 2 * (q1 * q2 - q0 * q3)
            r02 = 2 * (q1 * q3 + q0 * q2)
            r10 = 2 * (q1 * q2 + q0 * q3)
            r11 = 1 - 2 * (q1 * q1 + q3 * q3)
            r12 = 2 * (q2 * q3 - q0 * q1)
            r20 = 2 * (q1 * q3 - q0 * q2)
            r21 = 2 * (q2 * q3 + q0 * q1)
            r22 = 1 - 2 * (q1 * q1 + q2 * q2)
            air = 0.0 if gr else 1.0
            ax = (r00 * f0 + r01 * f1 + r02 * f2 - A.drag * (vx - air * wn[0])) * rI
            ay = (r10 * f0 + r11 * f1 + r12 * f2 - A.drag * (vy - air * wn[1])) * rI
            az = (r20 * f0 + r21 * f1 + r22 * f2 - A.drag * (vz - air * wn[2])) * rI + G
            if pz >= 0 and az >= 0:  # resting on (or hitting) the ground: sticky, attitude relaxes to level
                if not gr:
                    s.impact = math.sqrt(vx * vx + vy * vy + vz * vz)
                    gr = True
                    print(
                        "omni_hil: ground contact, speed %.2f m/s tilt %.1f"
                        % (s.impact, math.degrees(math.acos(max(-1, min(1, r22))))),
                        flush=True,
                    )
                pz = vx = vy = vz = wx = wy = wz = 0.0
                ax = ay = az = 0.0
                yaw = math.atan2(r10, r00)
                l0, l3 = math.cos(yaw / 2), math.sin(yaw / 2)
                if l0 * q0 + l3 * q3 < 0:
                    l0, l3 = -l0, -l3
                k = min(1.0, h / 0.2)
                q0 += (l0 - q0) * k
                q1 -= q1 * k
                q2 -= q2 * k
                q3 += (l3 - q3) * k
            else:
                gr = False
                wx += h * (m0 - 0.01 * wx) / I
                wy += h * (m1 - 0.01 * wy) / I
                wz += h * (m2 - 0.01 * wz) / I
                vx += h * ax
                vy += h * ay
                vz += h * az
                px += h * vx
                py += h * vy
                pz += h * vz
                x, y, z = wx * h, wy * h, wz * h
                nn = math.sqrt(x * x + y * y + z * z)
                k = 0.5 if nn < 1e-9 else math.sin(nn / 2) / nn
                cc = math.cos(nn / 2)
                x *= k
                y *= k
                z *= k
                q0, q1, q2, q3 = (
                    q0 * cc - q1 * x - q2 * y - q3 * z,
                    q0 * x + q1 * cc + q2 * z - q3 * y,
                    q0 * y - q1 * z + q2 * cc + q3 * x,
                    q0 * z + q1 * y - q2 * x + q3 * cc,
                )
            k = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
            q0 *= k
            q1 *= k
            q2 *= k
            q3 *= k
        s.p = np.array([px, py, pz])
        s.v = np.array([vx, vy, vz])
        s.q = np.array([q0, q1, q2, q3])
        s.w = np.array([wx, wy, wz])
        s.u = np.array(u)
        s.on_ground = gr
        s.R = q2R(s.q)
        s.f_spec = s.R.T @ np.array([ax, ay, az - G])


def main():
    srv = socket.socket()
    srv.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    srv.bind(("127.0.0.1", 4560 + A.instance))
    srv.listen(1)
    print("omni_hil: waiting for PX4 on tcp %d" % (4560 + A.instance), flush=True)
    c, _ = srv.accept()
    c.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    print("omni_hil: PX4 connected", flush=True)
    ml = mav.MAVLink(None, 1, 51)
    ml.robust_parsing = True
    truth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taddr = ("127.0.0.1", 4700 + A.instance)
    csvf = open(A.csv, "w") if A.csv else None
    if csvf:
        csvf.write(
            "wall,t,px,py,pz,vx,vy,vz,qw,qx,qy,qz,wx,wy,wz,armed," + ",".join("c%d" % i for i in range(N)) + "\n"
        )
    b = Body()
    t_us = 1_000_000_000  # start the PX4 clock well above 0
    t_start = t_us
    step_us = int(A.dt * 1e6)
    cmd = np.zeros(N)
    armed = False
    lockstep = False
    last_ctrl_us = 0
    wall0 = time.perf_counter()
    k = 0
    waited = 0
    missed = 0
    c.setblocking(False)
    clat = math.cos(math.radians(A.lat))

    def rx(timeout):
        """read what is there (wait up to timeout for it); returns number of HIL_ACTUATOR_CONTROLS"""
        nonlocal cmd, armed, lockstep, last_ctrl_us
        r, _, _ = select.select([c], [], [], timeout)
        if not r:
            return 0
        d = c.recv(4096)
        if not d:
            raise ConnectionError("PX4 closed")
        n = 0
        for m in ml.parse_buffer(d) or []:
            if m.get_msgId() == mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                n += 1
                armed = bool(m.mode & 128)
                last_ctrl_us = m.time_usec
                lockstep = bool(m.flags & 1)
                cmd = np.array(m.controls[:N]) if armed else np.zeros(N)
                for i in range(N):
                    if not math.isfinite(cmd[i]):
                        cmd[i] = 0
                lo = np.array([-1.0 if REV >> i & 1 else 0.0 for i in range(N)])
                cmd = np.clip(cmd, lo, 1.0)
        return n

    while True:
        if A.gust > 0:
            g = A.dt / 2.0
            gust[:] += -g * gust + A.gust * math.sqrt(2 * g) * rng.standard_normal(3)
            wind[:] = np.array(A.wind) + gust
        b.step(cmd, A.dt, A.substeps)
        t_us += step_us
        k += 1
        z = rng.standard_normal(9) * A.noise
        acc = b.f_spec + 0.03 * z[:3]
        gyr = b.w + (A.ground_shake if b.on_ground and A.ground_shake else A.gyro_noise) * z[3:6]
        fields = 0x3F
        mag = np.zeros(3)
        pabs = palt = temp = 0.0
        if k % 3 == 0:
            mag = b.R.T @ B_NED + 0.001 * z[6:9]
            fields |= 0x1C0
        if k % 5 == 0:
            h = A.alt - b.p[2]
            temp = 288.15 - 0.0065 * h
            pabs = 1013.25 * (temp / 288.15) ** 5.25588 + 0.01 * rng.standard_normal() * A.noise
            palt = h
            temp -= 273.15
            fields |= 0x1A00
        c.setblocking(True)
        msg = ml.hil_sensor_encode(t_us, *acc, *gyr, *mag, pabs, 0.0, palt, temp, fields, 0)
        buf = msg.pack(ml)
        ml.seq = (ml.seq + 1) % 256
        if k % 25 == 0:  # 10 Hz GPS
            n = rng.standard_normal(6) * A.noise
            p = b.p + np.array([0.02, 0.02, 0.04]) * n[:3]
            v = b.v + 0.02 * n[3:]
            cog = int(math.degrees(math.atan2(v[1], v[0])) % 360 * 100)
            g = ml.hil_gps_encode(
                t_us,
                3,
                int(round((A.lat + math.degrees(p[0] / R_E)) * 1e7)),
                int(round((A.lon + math.degrees(p[1] / (R_E * clat))) * 1e7)),
                int(round((A.alt - p[2]) * 1000)),
                60,
                90,
                int(round(np.hypot(v[0], v[1]) * 100)),
                *[int(round(x * 100)) for x in v],
                cog,
                14,
            )
            buf += g.pack(ml)
            ml.seq = (ml.seq + 1) % 256
        if k % 5 == 0:
            s = ml.hil_state_quaternion_encode(
                t_us,
                list(b.q),
                *b.w,
                int((A.lat + math.degrees(b.p[0] / R_E)) * 1e7),
                int((A.lon + math.degrees(b.p[1] / (R_E * clat))) * 1e7),
                int((A.alt - b.p[2]) * 1000),
                *[int(x * 100) for x in b.v],
                0,
                0,
                *[int(max(-32768, min(32767, x / G * 1000))) for x in b.f_spec],
            )
            buf += s.pack(ml)
            ml.seq = (ml.seq + 1) % 256
            st = dict(
                t=(t_us - t_start) * 1e-6,
                p=b.p.tolist(),
                v=b.v.tolist(),
                q=b.q.tolist(),
                w=b.w.tolist(),
                cmd=cmd.tolist(),
                armed=armed,
                ground=b.on_ground,
                wall=time.time(),
            )
            truth.sendto(json.dumps(st).encode(), taddr)
            if csvf:
                csvf.write(
                    "%.4f," % time.time()
                    + ",".join("%.9g" % x for x in [(t_us - t_start) * 1e-6, *b.p, *b.v, *b.q, *b.w, armed, *cmd])
                    + "\n"
                )
        c.sendall(buf)
        c.setblocking(False)
        # lockstep: wait for the controls that belong to this step
        if lockstep:
            end = time.perf_counter() + 0.5
            while last_ctrl_us < t_us:
                if rx(0.05) == 0 and time.perf_counter() > end:
                    missed += 1
                    break
        else:
            rx(0)
        if A.speed > 0:
            tgt = wall0 + k * A.dt / A.speed
            d = tgt - time.perf_counter()
            if d > 0:
                time.sleep(d)
            elif d < -0.2:
                wall0 -= d  # fell behind: do not try to catch up
        elif not lockstep:
            time.sleep(A.dt)
        if k % 2500 == 0:
            el = time.perf_counter()
            print(
                "omni_hil: t=%.0f s  rtf %.2f missed %d  pos %s armed %d"
                % (
                    (t_us - t_start) * 1e-6,
                    2500 * A.dt / (el - (main.tl if hasattr(main, "tl") else wall0)),
                    missed,
                    np.round(b.p, 2),
                    armed,
                ),
                flush=True,
            )
            main.tl = el
            if csvf:
                csvf.flush()


try:
    main()
except (ConnectionError, BrokenPipeError) as e:
    print("omni_hil: end (%s)" % e)
except KeyboardInterrupt:
    pass
