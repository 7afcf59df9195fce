#!/usr/bin/env python3
"""UDP gate between an autopilot's onboard link and a companion: cuts, delays, drops on command.
The autopilot sends to 14540+i (bound here), the companion listens on 24540+i. Control: UDP 4800+i, text:
  cut SECONDS | delay SECONDS [jitter] | loss P | rate BYTES_PER_S (serial-like, both ways) | quit
usage: gate.py --instance N"""

import argparse
import heapq
import random
import select
import socket
import time

from autopilots import GATE_CONTROL, ONBOARD

ap = argparse.ArgumentParser()
ap.add_argument("--instance", type=int, default=0)
ap.add_argument("--rate", type=float, default=0)
ap.add_argument("--delay", type=float, default=0)
ap.add_argument("--loss", type=float, default=0)
A = ap.parse_args()
i = A.instance


def sock(p):
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(("127.0.0.1", p))
    s.setblocking(False)
    return s


px, co, ctl = sock(ONBOARD + i), sock(20000 + ONBOARD + i), sock(GATE_CONTROL + i)
# Where the autopilot is shows once it speaks; before that nothing goes out: another pair's may be at PX4's usual port.
px_addr, co_addr = None, ("127.0.0.1", 10000 + ONBOARD + i)
cut_until = 0.0
delay, jit, loss, rate = A.delay, 0.0, A.loss, A.rate
q = []
n = 0
free = [0.0, 0.0]
counts = [0, 0, 0]


def put(which, data):
    global n
    now = time.monotonic()
    if now < cut_until or random.random() < loss:
        counts[2] += 1
        return
    t = now + delay + random.random() * jit
    if rate:
        start = max(now, free[which])
        if start - now > 0.3:
            counts[2] += 1
            return  # a full buffer
        free[which] = start + len(data) / rate
        t = free[which] + delay
    counts[which] += 1
    if t <= now:
        out(which, data)
    else:
        n += 1
        heapq.heappush(q, (t, n, which, data))


def out(which, data):
    to, address = (co, co_addr) if which == 0 else (px, px_addr)
    try:
        if address:
            to.sendto(data, address)
    except OSError:
        pass


while True:
    w = 0.5 if not q else max(0.0, q[0][0] - time.monotonic())
    r, _, _ = select.select([px, co, ctl], [], [], w)
    for s in r:
        try:
            d, a = s.recvfrom(65535)
        except OSError:
            continue
        if s is px:
            px_addr = a
            put(0, d)
        elif s is co:
            put(1, d)
        else:
            k = d.decode().split()
            if k[0] == "cut":
                cut_until = time.monotonic() + float(k[1])
            elif k[0] == "delay":
                delay = float(k[1])
                jit = float(k[2]) if len(k) > 2 else 0.0
            elif k[0] == "loss":
                loss = float(k[1])
            elif k[0] == "rate":
                rate = float(k[1])
            elif k[0] == "quit":
                raise SystemExit
            print(time.time(), d.decode(), counts, flush=True)
    while q and q[0][0] <= time.monotonic():
        _, _, which, d = heapq.heappop(q)
        out(which, d)
