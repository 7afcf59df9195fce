#!/usr/bin/env python3
"""Holds a flight's score (score.py --json on standard input) and its end (end.json) against the bars.
usage: score.py DIR --json | judge.py DIR completed|safe
completed: every slot served in full at its pose, both landed and disarmed. safe: a fault was flown, and both ended on the ground.
Both: never unprotected, and PX4 has its land detector back in every vehicle whose companion is alive or was told to end."""
import json
import sys

# By frame: position in a slot, m rms; what is judged of the attitude, and its bar, deg rms; how far past a pose, m. The six's heading
# is its compass's, of which the antenna's axis knows nothing, and it swings when its offsets turn; the level quad's attitude is
# the wind's.
BARS = dict(px4=(0.08, "att", 0.3, 0.5), six=(0.25, "axis", 0.5, 2.0), quad=(0.30, None, None, 0.5))

folder, kind = sys.argv[1:3]
score = json.load(sys.stdin)
with open(folder + "/end.json") as file:
    end = json.load(file)
with open(folder + "/setup.json") as file:
    options = json.load(file)["args"]
bad = []


def bar(what, value, holds):
    print(("ok  " if holds else "FAIL"), what, value)
    if not holds:
        bad.append(what)


bar("unprotected, s", score["unprotected_s"], score["unprotected_s"] == 0)
bar("LNDMC_Z_VEL_MAX", end["guard"], all(value and value > 0 for value in end["guard"]))
bar("simulated seconds a second", score["rtf"], all(0.97 < rate < 1.03 for rate in score["rtf"].values()))
bar("armed", end["armed"], not any(end["armed"]))
if kind == "completed":
    bar("exit codes", end["exits"], all(code == 0 for codes in end["exits"] for code in codes.values()))
    bar("slots", len(score["slots"]), bool(score["slots"]))
    slot_s = options["slot"] or 10.0
    for slot in score["slots"]:
        for role in "ij":
            name = f"slot {slot['slot']}, vehicle {role}"
            most_m, what, most_deg, most_past_m = BARS[options[role]]
            position = slot["pos_" + role][0]
            bar(f"{name}: position rms, m", position, position <= most_m)
            if what:
                off = slot[f"{what}_{role}"][0]
                bar(f"{name}: {what} rms, deg", off, off <= most_deg)
            if slot["past_" + role] is not None:
                bar(f"{name}: past its pose, m", slot["past_" + role], slot["past_" + role] <= most_past_m)
            seconds = slot["on_" + role] / end["missions"]
            bar(f"{name}: on the air, s", round(seconds, 2), seconds >= slot_s - (1.1 if role == "i" else 0.6))
else:
    for role in "ij":
        print("    ", role, "modes", score["modes_" + role], "ended", score["end_" + role])
    for event in score.get("after", []):
        print("     silent after", event[0], event[1])
sys.exit(1 if bad else 0)
