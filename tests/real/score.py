#!/usr/bin/env python3
"""Scores a pair flight (pair.py's folder) from the simulators' true poses and the transmitters' logs.
usage: score.py DIR [--plan plan.json] [--json]      VEILWING: the program, to plan the mission (or --plan)
Written apart from the project: geo.py, the paper's formulas (ARCHITECTURE: body Z is the dipole axis)."""

import geo
import numpy as np
import csv
import datetime
import glob
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import tomllib


D = sys.argv[1]
setup = json.load(open(D + "/setup.json"))
O = setup["origin"]
mission = tomllib.load(open(D + "/mission.toml", "rb"))
plan = json.loads(
    subprocess.run(
        [os.environ["VEILWING"], "plan", D + "/mission.toml", "--json"], capture_output=True, text=True
    ).stdout
)
NED2ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FLIP = np.diag([1.0, -1, -1])


def q2R(q):
    w, x, y, z = (q / np.linalg.norm(q, axis=1)[:, None]).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )


def euler(r, p, y):
    cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def load(r):
    rows = [x for x in csv.reader(open(f"{D}/{r}/truth.csv"))]
    n = len(rows[0])
    a = np.array([x for x in rows[1:] if len(x) == n], float)
    h = {k: i for i, k in enumerate(rows[0])}
    v = a[:, h["vx"] : h["vz"] + 1]
    R = q2R(a[:, h["qw"] : h["qz"] + 1])
    if "lat" in h:
        e = geo.to_enu(a[:, h["lat"]], a[:, h["lon"]], a[:, h["alt"]], O)
    else:
        e = geo.hil_to_enu(a[:, h["px"] : h["pz"] + 1], setup["homes"][r], O)
    return dict(
        t=a[:, h["wall"]],
        sim=a[:, h["t"]],
        e=e,
        v=v @ NED2ENU.T,
        R=NED2ENU @ R @ FLIP,
        armed=a[:, h["armed"]] > 0,
        u=np.abs(a[:, h["c0"] :]).max(1),
    )


T = {r: load(r) for r in "ij"}


def intervals(r):
    """[(on, off, [(t, dbm, slot)])]"""
    out, cur = [], None
    for l in open(f"{D}/tx-{r}.log"):
        m = json.loads(l)
        if m.get("on") is True:
            if cur is None:
                cur = [m["t"], None, []]
            cur[2].append((m["t"], m["dbm"], m["slot"]))
        elif m.get("on") is False and cur:
            cur[1] = m["t"]
            cur.append(m["why"])
            cur.append(m.get("last", m["t"]))
            out.append(cur)
            cur = None
    if cur:
        cur[1] = T[r]["t"][-1]
        cur += ["never", cur[1]]
        out.append(cur)
    return out


TX = {r: intervals(r) for r in "ij"}
users = [u["enu_m"] for u in mission["user"]]
names = [u.get("name", f"user-{k+1}") for k, u in enumerate(mission["user"])]
eaves = [e["enu_m"] for e in mission["eavesdropper"]]
radio = mission.get("radio", {})
noise = radio.get("noise_power_w", 1e-12)
b0 = radio.get("reference_gain", 1.0)
BW = radio.get("bandwidth_hz", 1e6)


def at(r, t, k):
    x = T[r]
    i = np.clip(np.searchsorted(x["t"], t), 1, len(x["t"]) - 1)
    f = np.clip((t - x["t"][i - 1]) / np.maximum(x["t"][i] - x["t"][i - 1], 1e-6), 0, 1)
    if k == "R":
        return x["R"][np.where(f > 0.5, i, i - 1)]
    return x[k][i - 1] + f[:, None] * (x[k][i] - x[k][i - 1])


def rate(pI, zI, PI, pJ, zJ, PJ, user, eaves=eaves, floor=0.0):
    def g(p, z, s):
        d = s - p
        return floor + (1 - floor) * np.maximum(0, np.sum(np.cross(z, d) ** 2, -1) / np.sum(d * d, -1))

    def sinr(s):
        s = np.asarray(s, float)
        dI, dJ = np.sum((s - pI) ** 2, -1), np.sum((s - pJ) ** 2, -1)
        return b0 * g(pI, zI, s) * PI / dI / (b0 * g(pJ, zJ, s) * PJ / dJ + noise)

    return np.maximum(0, np.log2(1 + sinr(user)) - np.max([np.log2(1 + sinr(e)) for e in eaves], 0))


def power(r, t):
    """W at each instant, from the transmitter's log."""
    p = np.zeros(len(t))
    s = np.full(len(t), -1)
    for on, off, seg, *_ in TX[r]:
        for k, (a, dbm, slot) in enumerate(seg):
            b = seg[k + 1][0] if k + 1 < len(seg) else off
            m = (t >= a) & (t < b)
            p[m] = 10 ** (dbm / 10) / 1000
            s[m] = slot
    return p, s


def planned(slot, r, since):
    """Rotations (n, 3, 3) that the plan has a vehicle in, so many seconds (n) after its user's service began: where it turns on the
    air its roll, pitch and yaw run evenly from knot to knot; before and after it has those of the ends."""
    knots = slot.get("knots") or [dict(slot, at_s=0.0)]
    at = np.array([knot["at_s"] - knots[0]["at_s"] for knot in knots])
    angles = [[knot["vehicles"][r][name] for knot in knots] for name in ("roll_rad", "pitch_rad", "yaw_rad")]
    roll, pitch, yaw = (np.interp(since, at, values) for values in angles)
    return np.array([euler(*each) for each in zip(roll, pitch, yaw)])


def places(slot, r, since):
    """Places (n, 3) likewise: on the periodic cubic B-spline that the plan's control points draw, where it moves."""
    if "motion" not in plan:
        return np.tile(slot["vehicles"][r]["position_enu_m"], (len(since), 1))
    points = np.array(plan["motion"]["control_enu_m"][r])
    at = (slot["knots"][0]["at_s"] + since) / plan["motion"]["period_s"] % 1 * len(points)
    off = np.abs(at[:, None] - np.arange(len(points)))
    off = np.minimum(off, len(points) - off)
    weights = np.where(off < 1, (4 - 6 * off**2 + 3 * off**3) / 6, np.maximum(2 - off, 0) ** 3 / 6)
    return weights @ points


# ---- who moves: where everybody truly is, and what could have been had there at each instant
TRACKS = {}
if os.path.exists(D + "/movers.csv"):
    for wall, kind, name, *at_enu in list(csv.reader(open(D + "/movers.csv")))[1:]:
        TRACKS.setdefault((kind, name), []).append([float(wall), *map(float, at_enu)])
TRACKS = {who: np.array(rows) for who, rows in TRACKS.items()}


def whereabouts(kind, node, t):
    """(n, 3): where one of the mission's nodes is at each instant."""
    track = TRACKS.get((kind, node["name"]))
    if track is None:
        return np.tile(np.array(node["enu_m"], float), (len(t), 1))
    return np.stack([np.interp(t, track[:, 0], track[:, 1 + k]) for k in range(3)], -1)


def had(slot, powers, *where):
    """The rate of a pair that is where the plan has it; the user's place and the rest as in rate()."""
    posed = [(np.array(v["position_enu_m"]), euler(v["roll_rad"], v["pitch_rad"], v["yaw_rad"])[:, 2]) for v in (slot["vehicles"][r] for r in "ij")]
    return rate(*posed[0], powers[0], *posed[1], powers[1], *where)


def planned_powers(slot):
    return [slot["vehicles"][r]["tx_power_w"] for r in "ij"]


def best_there(name, k, t, floor):
    """The rate of the plan that is made for where everybody truly is at one instant, there and then: nobody can be there as fast."""
    text = open(D + "/mission.toml").read()
    for kind, which in (("user", mission["user"]), ("eavesdropper", mission["eavesdropper"])):
        for node in which:
            x = whereabouts(kind, node, t[k : k + 1])[0].tolist()
            text = re.sub(rf'^name = "{node["name"]}".*?^enu_m = [^\n]*$', f'name = "{node["name"]}"\nenu_m = {x}', text, count=1, flags=re.M | re.S)
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(text)
        file.flush()
        made = subprocess.run([os.environ["VEILWING"], "plan", file.name, "--json"], capture_output=True, text=True)
    slot = next(one for one in json.loads(made.stdout)["slots"] if one["user"] == name)
    user, listeners = mission["user"][names.index(name)], mission["eavesdropper"]
    return float(had(slot, planned_powers(slot), whereabouts("user", user, t[k : k + 1]), [whereabouts("eavesdropper", e, t[k : k + 1]) for e in listeners], floor)[0])


# ---- unprotected: I on while J off
unprot = 0.0
worst = 0.0
# On a line that is looked at now and then I is certainly on from when it is first to when it is last seen on.
for on, *_, off in TX["i"]:
    cov = sorted((max(on, a), min(off, b)) for a, b, *_ in TX["j"] if b > on and a < off)
    u = (off - on) - sum(b - a for a, b in cov)
    unprot += u
    worst = max(worst, u)
# ---- separation
lo, hi = max(T["i"]["t"][0], T["j"]["t"][0]), min(T["i"]["t"][-1], T["j"]["t"][-1])
grid = np.arange(lo, hi, 0.02)
sep = np.linalg.norm(at("i", grid, "e") - at("j", grid, "e"), axis=1)
air = (at("i", grid, "e")[:, 2] > 1) & (at("j", grid, "e")[:, 2] > 1)
res = dict(
    slots=[],
    unprotected_s=round(unprot, 4),
    least_separation_m=round(float(sep[air].min()), 2) if air.any() else None,
)
res["rtf"] = {r: round(float((T[r]["sim"][-1] - T[r]["sim"][0]) / (T[r]["t"][-1] - T[r]["t"][0])), 3) for r in "ij"}
tdma = mission.get("tdma", {})
slot_ids = sorted({s for r in "ij" for _, _, seg, *_ in TX[r] for _, _, s in seg})
order = [s["user"] for s in plan["slots"]]
for sid in slot_ids:
    ps = plan["slots"][sid % len(plan["slots"])]
    row = dict(slot=int(sid), user=ps["user"], planned=round(ps["secrecy_rate_bps"] / BW, 3))
    user = users[names.index(ps["user"])]
    for r in "ij":
        segs = [(on, off, why) for on, off, seg, why, _ in TX[r] if any(x[2] == sid for x in seg)]
        row["on_" + r] = round(sum(b - a for a, b, _ in segs), 2)
        row["n_" + r] = len(segs)
        row["off_" + r] = ",".join(w for *_, w in segs)
        if not segs:
            continue
        m = np.zeros(len(T[r]["t"]), bool)
        for a, b, _ in segs:
            m |= (T[r]["t"] >= a) & (T[r]["t"] < b)
        if not m.any():
            continue
        # I is on when its user's service begins, but for a lease's way.
        began = min([on for on, _, seg, *_ in TX["i"] if any(x[2] == sid for x in seg)] or [segs[0][0]])
        off = T[r]["e"][m] - places(ps, r, T[r]["t"][m] - began)
        pe = np.linalg.norm(off, axis=1)
        Rp = planned(ps, r, T[r]["t"][m] - began)
        c = (np.einsum("nij,nij->n", Rp, T[r]["R"][m]) - 1) / 2
        ae = np.degrees(np.arccos(np.clip(c, -1, 1)))
        zc = np.abs(np.sum(T[r]["R"][m][:, :, 2] * Rp[:, :, 2], axis=1))
        ax = np.degrees(np.arccos(np.clip(zc, 0, 1)))
        bears = [knot["tolerance"] for knot in ps.get("knots", []) if knot.get("tolerance")]
        if bears:
            row["bears_" + r] = [min(one[name][r] for one in bears) for name in ("position_m", "pointing_deg")]
        row["pos_" + r] = (round(float(np.sqrt((pe**2).mean())), 3), round(float(pe.max()), 3))
        row["mean_" + r] = np.round(off.mean(0), 3).tolist()
        row["att_" + r] = (round(float(np.sqrt((ae**2).mean())), 2), round(float(ae.max()), 2))
        row["axis_" + r] = (round(float(np.sqrt((ax**2).mean())), 2), round(float(ax.max()), 2))
        row["tilt_" + r] = round(float(np.degrees(np.arccos(np.clip(Rp[:, 2, 2], -1, 1))).max()), 1)
        row["umax_" + r] = round(float(T[r]["u"][m].max()), 2)
    t = grid
    PI, sI = power("i", t)
    PJ, sJ = power("j", t)
    m = (PI > 0) & (PJ > 0) & (sI == sid) & (sJ == sid)
    if m.any():
        rr = rate(
            at("i", t[m], "e"),
            at("i", t[m], "R")[:, :, 2],
            PI[m],
            at("j", t[m], "e"),
            at("j", t[m], "R")[:, :, 2],
            PJ[m],
            user,
        )
        row["rate"] = round(float(rr.mean()), 3)
        row["rate_min"] = round(float(rr.min()), 2)
        row["rate_exact"] = round(float(had(ps, [PI[m].max(), PJ[m].max()], user)), 3)
        if TRACKS:
            floor = 10 ** (-mission["antenna"]["null_depth_db"] / 10)
            true_user = whereabouts("user", mission["user"][names.index(ps["user"])], t[m])
            listeners = [whereabouts("eavesdropper", e, t[m]) for e in mission["eavesdropper"]]
            place = [(at(r, t[m], "e"), at(r, t[m], "R")[:, :, 2], p) for r, p in (("i", PI[m]), ("j", PJ[m]))]
            row["followed"] = round(float(rate(*place[0], *place[1], true_user, listeners, floor).mean()), 3)
            row["staying"] = round(float(had(ps, planned_powers(ps), true_user, listeners, floor).mean()), 3)
            looks = range(0, int(m.sum()), 100)
            row["best_at_each_instant"] = round(float(np.mean([best_there(ps["user"], k, t[m], floor) for k in looks])), 3)
        row["dbm"] = (round(10 * math.log10(PI[m].max() * 1e3), 2), round(10 * math.log10(PJ[m].max() * 1e3), 2))
    res["slots"].append(row)
def said(r, pattern):
    """Wall times at which a companion's log has it; its stamps are UTC."""
    at = []
    for name in sorted(glob.glob(f"{D}/{r}/companion*.log")):
        for line in open(name, errors="replace"):
            if re.search(pattern, line):
                stamp = re.sub(r"\x1b\[[0-9;]*m", "", line).split()[0]
                at.append(datetime.datetime.fromisoformat(stamp).timestamp())
    return at


def overshoot(r, slot):
    """How far it flies past the slot's pose along its way there, horizontally, m; None where the way is shorter than a metre, or goes on."""
    if "motion" in plan:
        return None
    agreed, over = said(r, f"slot {slot} for .*agreed"), said(r, f"slot {slot} for .*(over|not served|abandoned)")
    if not agreed or not over:
        return None
    x, goal = T[r], np.array(plan["slots"][slot % len(plan["slots"])]["vehicles"][r]["position_enu_m"][:2])
    m = (x["t"] >= agreed[0]) & (x["t"] <= over[0])
    if not m.any():
        return None
    way = goal - x["e"][m][0, :2]
    length = np.linalg.norm(way)
    return round(float(((x["e"][m][:, :2] - goal) @ way / length).max()), 2) if length >= 1 else None


for r in "ij":
    for row in res["slots"]:
        row["past_" + r] = overshoot(r, row["slot"])
    res["end_" + r] = dict(at=np.round(T[r]["e"][-1], 2).tolist(), from_home_m=round(float(np.linalg.norm((T[r]["e"][-1] - T[r]["e"][0])[:2])), 2))
    res["modes_" + r] = [
        (round(x[0] - lo, 2), x[3], "armed" if x[4] else "disarmed")
        for x in map(json.loads, open(f"{D}/gcs.log"))
        if x[1] == "mode" and x[2] == ["ij".index(r) + 1, 1]
    ]
    res["tx_" + r] = [
        dict(on=round(float(a - lo), 2), off=round(float(b - lo), 2), why=w, slots=sorted({x[2] for x in seg}))
        for a, b, seg, w, _ in TX[r]
    ]
    if os.path.exists(f"{D}/{r}/sim.log"):
        res["impacts_" + r] = [l.strip() for l in open(f"{D}/{r}/sim.log") if "ground contact" in l]
try:
    ev = json.load(open(D + "/events.json"))
    res["events"] = [(round(t - lo, 2), a) for t, a in ev]
    for t, a in ev:  # reaction: how long each radio stayed on after it
        res.setdefault("after", []).append(
            (
                a,
                {r: [round(off - t, 3) for on, off, *_ in TX[r] if on < t < off] for r in "ij"},
                {r: [round(on - t, 2) for on, *_ in TX[r] if on > t] for r in "ij"},
            )
        )
except FileNotFoundError:
    pass
if "--json" in sys.argv:
    print(json.dumps(res, indent=1))
else:
    print(f"unprotected {res['unprotected_s']} s, least separation {res['least_separation_m']} m, rtf {res['rtf']}")
    for s in res["slots"]:
        print(" ", {k: v for k, v in s.items()})
    for k in ("tx_i", "tx_j", "modes_i", "modes_j", "end_i", "end_j", "impacts_i", "impacts_j", "after"):
        print(" ", k, res.get(k))
