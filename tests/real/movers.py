"""People and cars that move, and their handsets: each walks or drives about where the mission has it, and says where it is once a second,
as a handset of its own system would: with 3 m of noise, a fifth of what it says lost. Where it truly is stands in movers.csv."""

import csv
import math
import random
import threading
import time

import geo

# Speed, m/s; how fast it turns, rad/s; how far it goes from where the mission has it, m.
GAITS = dict(walks=(1.5, 0.3, 60.0), drives=(8.0, 0.4, 120.0))
STEP_S, REPORT_S, NOISE_M, LOST = 0.05, 1.0, 3.0, 0.2


class Movers(threading.Thread):
    def __init__(self, folder, who, origin, ground):
        """`who`: name, kind ("user" or "eavesdropper"), ENU, gait and MAVLink system of each."""
        super().__init__(daemon=True)
        self.origin, self.ground, self.random = origin, ground, random.Random(7)
        self.who = [dict(one, at=list(one["enu"]), heading=self.random.uniform(-math.pi, math.pi), v=(0.0, 0.0)) for one in who]
        self.file = open(folder + "/movers.csv", "w", buffering=1)
        self.out = csv.writer(self.file)
        self.out.writerow(["wall", "kind", "name", "east_m", "north_m", "up_m"])

    def run(self):
        began, step, reported = time.time(), 0, 0
        while True:
            step += 1
            now = began + STEP_S * step
            time.sleep(max(0.0, now - time.time()))
            for one in self.who:
                self.go(one)
                self.out.writerow(["%.3f" % now, one["kind"], one["name"], *("%.3f" % x for x in one["at"])])
            if now - began >= REPORT_S * reported:
                reported += 1
                for one in self.who:
                    if self.random.random() >= LOST:
                        self.say(one, now)

    def go(self, one):
        """A step ahead; back towards home from too far away, else hither and thither."""
        speed, turn, far = GAITS[one["gait"]]
        back = [home - at for home, at in zip(one["enu"], one["at"])]
        if math.hypot(*back[:2]) > far:
            off = math.remainder(math.atan2(back[1], back[0]) - one["heading"], 2 * math.pi)
            one["heading"] += max(-turn, min(turn, off / STEP_S)) * STEP_S
        else:
            one["heading"] += turn * self.random.gauss(0.0, 1.0) * math.sqrt(STEP_S)
        one["v"] = speed * math.cos(one["heading"]), speed * math.sin(one["heading"])
        one["at"][0] += one["v"][0] * STEP_S
        one["at"][1] += one["v"][1] * STEP_S

    def say(self, one, now):
        noisy = [at + self.random.gauss(0.0, NOISE_M) for at in one["at"][:2]] + [one["at"][2]]
        lat, lon, height = (float(x) for x in geo.from_enu(noisy, self.origin))
        self.ground.handset(one["system"]).global_position_int_send(
            int(1e3 * now) & 0xFFFFFFFF, round(1e7 * lat), round(1e7 * lon), round(1e3 * height), round(1e3 * noisy[2]),
            round(100 * one["v"][1]), round(100 * one["v"][0]), 0, 65535,
        )  # fmt: skip
