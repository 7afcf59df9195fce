#!/usr/bin/env python3
"""The planner beside general solvers, on the same scenarios and the same machine.

    python3 -m venv env && env/bin/pip install casadi scipy
    env/bin/python benches/side_by_side/compare.py [--every 25] [--starts 40] [--scipy-starts 10]

Ipopt (bundled with CasADi) maximises the rate over all twelve variables from many random starts, with exact gradients and
a limited-memory Hessian; under jitter, the mean over 64 Sobol points. (In epigraph form with exact Hessians it fares
worse: 12 where this form reaches 24.) SciPy's SLSQP does the same from fewer starts. The planner is the example `reference plans`. All plans are scored here, by NumPy,
on 16,384 points: a second opinion on the planner's own figure. Times are wall-clock, one thread each; the planner's is
the median of five.
"""

import argparse
import csv
import io
import os
import pathlib
import subprocess
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import casadi as ca
import numpy as np
from scipy.optimize import minimize
from scipy.stats import norm, qmc

ROOT = pathlib.Path(__file__).resolve().parents[2]
PMAX, NOISE = 0.5, 1e-12
LOW = np.array([-500, -500, 80, -np.pi / 2, -np.pi / 2, 1e-9] * 2)
HIGH = np.array([500, 500, 300, np.pi / 2, np.pi / 2, PMAX] * 2)


def eavesdroppers(n, scenario):
    with open(ROOT / f"tests/reference/eavesdroppers_n{n}.csv") as file:
        row = [float(v) for v in list(csv.reader(file))[1 + scenario]]
    return np.array(row[1:]).reshape(n, 2)


def jitter(deg, count, seed):
    if deg == 0:
        return np.zeros((1, 4))
    return np.radians(deg) * norm.ppf(qmc.Sobol(4, seed=seed).random(count))


def score(plan, nodes, noise):
    """E[R] with [.]^+ inside, in bit/s/Hz."""
    user_and_nodes = np.vstack([[0.0, 0.0], nodes])

    def received(part, w):
        roll, pitch = part[3] + w[:, 0], part[4] + w[:, 1]
        axis = np.stack([np.cos(roll) * np.sin(pitch), -np.sin(roll), np.cos(roll) * np.cos(pitch)], 1)
        path = part[:3] - np.column_stack([user_and_nodes, np.zeros(len(user_and_nodes))])
        square = (path**2).sum(1)
        return part[5] * (1 - (axis @ path.T) ** 2 / square) / square / NOISE

    sinr = received(plan[:6], noise[:, :2]) / (received(plan[6:], noise[:, 2:]) + 1)
    rate = np.log2((1 + sinr[:, 0]) / (1 + sinr[:, 1:].max(1)))
    return np.maximum(rate, 0).mean()


def symbolic(nodes, noise):
    """Variables scaled to [0, 1], the rates log2(1 + G0) - log2(1 + Gj) per sample."""
    x = ca.SX.sym("x", 12)
    v = LOW + ca.diag(HIGH - LOW) @ x
    points = [(0.0, 0.0)] + [tuple(p) for p in nodes]

    def received(part, w, point):
        roll, pitch = part[3] + w[0], part[4] + w[1]
        axis = ca.vertcat(ca.cos(roll) * ca.sin(pitch), -ca.sin(roll), ca.cos(roll) * ca.cos(pitch))
        path = part[:3] - ca.vertcat(point[0], point[1], 0)
        square = ca.dot(path, path)
        return part[5] / NOISE * (1 - ca.dot(axis, path) ** 2 / square) / square

    rates = []
    for w in noise:
        logs = [
            ca.log1p(received(v[:6], w[:2], p) / (received(v[6:], w[2:], p) + 1)) / np.log(2) for p in points
        ]
        rates.append([logs[0] - other for other in logs[1:]])
    return x, rates


def build(nodes, noise):
    """The Ipopt solver, and a smooth-enough objective with gradient for SciPy."""
    x, rates = symbolic(nodes, noise)
    least = [r[0] if len(r) == 1 else ca.mmin(ca.vertcat(*r)) for r in rates]
    mean = sum(least) / len(least)
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.max_iter": 300, "ipopt.sb": "yes"}
    options["ipopt.hessian_approximation"] = "limited-memory"
    problem = {"x": x, "f": -mean}
    solver = ca.nlpsol("s", "ipopt", problem, options)
    value = ca.Function("f", [x], [-mean, ca.gradient(-mean, x)])
    return solver, value


def ipopt(solver, noise, nodes, starts, rng):
    best, plan = -np.inf, None
    for _ in range(starts):
        out = solver(x0=rng.random(12), lbx=0, ubx=1)
        found = LOW + (HIGH - LOW) * np.clip(np.array(out["x"]).ravel(), 0, 1)
        value = score(found, nodes, noise)
        if value > best:
            best, plan = value, found
    return plan


def slsqp(value, noise, nodes, starts, rng):
    def objective(x):
        f, g = value(x)
        return float(f), np.array(g).ravel()

    best, plan = -np.inf, None
    for _ in range(starts):
        out = minimize(objective, rng.random(12), jac=True, method="SLSQP", bounds=[(0, 1)] * 12, options={"maxiter": 300})
        found = LOW + (HIGH - LOW) * np.clip(out.x, 0, 1)
        worth = score(found, nodes, noise)
        if worth > best:
            best, plan = worth, found
    return plan


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=25)
    parser.add_argument("--starts", type=int, default=40)
    parser.add_argument("--scipy-starts", type=int, default=10)
    arguments = parser.parse_args()
    command = ["cargo", "run", "--release", "--quiet", "--no-default-features", "--example", "reference", "--", "plans"]
    text = subprocess.run(command + ["--every", str(arguments.every)], cwd=ROOT, capture_output=True, text=True, check=True)
    print(" N  deg scenario | veilwing      ms | Ipopt        ms    rate ratio  time ratio | SLSQP        ms  time ratio")
    ratios = {}
    for row in csv.DictReader(io.StringIO(text.stdout)):
        n, scenario, deg, ms = int(row["n"]), int(row["scenario"]), float(row["jitter_deg"]), float(row["ms"])
        ours = np.array([float(v) for v in list(row.values())[5:]])
        nodes = eavesdroppers(n, scenario)
        noise, fine = jitter(deg, 64, 1), jitter(deg, 16384, 2)
        solver, value = build(nodes, noise)
        rng = np.random.default_rng(scenario)
        line = [score(ours, nodes, fine)]
        for run, starts in ((lambda k: ipopt(solver, noise, nodes, k, rng), arguments.starts),
                            (lambda k: slsqp(value, noise, nodes, k, rng), arguments.scipy_starts)):
            before = time.perf_counter()
            plan = run(starts)
            line += [score(plan, nodes, fine), (time.perf_counter() - before) * 1e3]
        assert abs(line[0] / float(row["rate_bit_s_hz"]) - 1) < 3e-3, "the planner's figure and this script's differ"
        print(
            f"{n:2} {deg:4.0f} {scenario:8} | {line[0]:8.4f} {ms:7.2f} | {line[1]:8.4f} {line[2]:9.0f}"
            f" {line[0] / line[1]:10.4f} {line[2] / ms:11.0f} | {line[3]:8.4f} {line[4]:9.0f} {line[4] / ms:11.0f}",
            flush=True,
        )
        ratios.setdefault((n, deg), []).append((line[0] / line[1], line[2] / ms))
    for (n, deg), pairs in ratios.items():
        rate, speed = np.median(pairs, axis=0)
        print(f"N = {n}, {deg:.0f} deg: median rate ratio to Ipopt {rate:.4f}, median time ratio {speed:.0f}")


if __name__ == "__main__":
    main()
