#!/usr/bin/env python3
"""Holds a flight's score (score.py --json on standard input) and its end (end.json) against the bars.
usage: score.py DIR --json | judge.py DIR completed|safe
completed: every slot served, position within 0.08 m rms, attitude within 0.3 deg rms, both landed and disarmed. safe: a fault was
flown. Both: never unprotected, and PX4 has its land detector back in every vehicle whose companion is alive or was told to end."""
import json
import sys

folder, kind = sys.argv[1:3]
score = json.load(sys.stdin)
with open(folder + "/end.json") as file:
    end = json.load(file)
bad = []


def bar(what, value, holds):
    print(("ok  " if holds else "FAIL"), what, value)
    if not holds:
        bad.append(what)


bar("unprotected, s", score["unprotected_s"], score["unprotected_s"] == 0)
bar("LNDMC_Z_VEL_MAX", end["guard"], all(value and value > 0 for value in end["guard"]))
bar("simulated seconds a second", score["rtf"], all(rate > 0.97 for rate in score["rtf"].values()))
if kind == "completed":
    bar("exit codes", end["exits"], all(code == 0 for codes in end["exits"] for code in codes.values()))
    bar("armed", end["armed"], not any(end["armed"]))
    missions = len(end["exits"])
    for slot in score["slots"]:
        for role in "ij":
            name = f"slot {slot['slot']}, vehicle {role}"
            position, attitude = slot["pos_" + role][0], slot["att_" + role][0]
            bar(f"{name}: position rms, m", position, position <= 0.08)
            bar(f"{name}: attitude rms, deg", attitude, attitude <= 0.3)
            seconds = slot["on_" + role] / missions
            bar(f"{name}: on the air, s", round(seconds, 2), seconds >= (8.9 if role == "i" else 9.4))
sys.exit(1 if bad else 0)
