#!/usr/bin/env python3
"""Holds a flight's score (score.py --json on standard input) and its end (end.json) against the bars.
usage: score.py DIR --json | judge.py DIR completed|safe
completed: every slot served in full at its pose (or, where somebody moves, followed), both landed and disarmed. safe: a fault was flown, and both ended on the ground.
Both: never unprotected, and PX4 has its land detector back in every vehicle whose companion is alive or was told to end."""
import json
import sys
import tomllib

import geo

# By frame: position in a slot, m rms; what is judged of the attitude, and its bar, deg rms; how far past a pose, m. The six's heading
# is its compass's, of which the antenna's axis knows nothing, and it swings when its offsets turn; the level quad's attitude is
# the wind's. The receiver of PX4's own quad errs by up to a metre, and the vehicle follows it.
BARS = dict(px4=(0.08, "att", 0.3, 0.5), six=(0.25, "axis", 0.5, 2.0), quad=(0.30, None, None, 0.5), sih=(1.5, None, None, 2.0))

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
# The fence as another station reads it: the mission's area, which is a rectangle, five metres wider; and the rally point at home.
with open(folder + "/mission.toml", "rb") as file:
    area = tomllib.load(file)["airspace"]["area_enu_m"]
with open(folder + "/setup.json") as file:
    setup = json.load(file)
wanted = sorted([x + (5 if x > 0 else -5) for x in corner] for corner in area)
for role in "ij":
    at = {}
    for name, found in end["lists"][role].items():
        places = [one[2:] for one in found or [] if one]
        at[name] = [geo.to_enu(*place, setup["origin"][2], setup["origin"]).tolist()[:2] for place in places]
    near = len(at["fence"]) == len(wanted) and all(
        abs(a - b) < 0.1 for one, other in zip(sorted(at["fence"], key=lambda one: [round(x) for x in one]), wanted) for a, b in zip(one, other)
    )
    bar(f"vehicle {role}: the fence read by the ground, m", [[round(x, 2) for x in one] for one in at["fence"]], near)
    home = options["home_" + role][:2]
    near = len(at["rally"]) == 1 and all(abs(a - b) < 1.5 for a, b in zip(at["rally"][0], home))
    bar(f"vehicle {role}: the rally point, m", [[round(x, 2) for x in one] for one in at["rally"]], near)
if kind == "completed":
    bar("exit codes", end["exits"], all(code == 0 for codes in end["exits"] for code in codes.values()))
    bar("slots", len(score["slots"]), bool(score["slots"]))
    slot_s = options["slot"] or 10.0
    gaits = dict(one.split("=") for one in options["moves"])
    for slot in score["slots"]:
        if gaits:
            # Where the served user truly was: no less than from the plan's poses, and most of what nobody can have, being at each instant
            # where it is best then; of one that drives as fast as the vehicles fly a part.
            part = dict(walks=0.7, drives=0.3)[gaits.get(slot["user"], "walks")]
            rates = [slot[name] for name in ("followed", "staying", "best_at_each_instant")]
            bar(f"slot {slot['slot']}: bit/s/Hz followed, staying, best at each instant", rates, rates[0] >= max(rates[1], part * rates[2]))
            bar(f"slot {slot['slot']}: on the air, s", slot["on_i"], slot["on_i"] >= 0.95 * (slot_s - 1.1))
            continue
        for role in "ij":
            name = f"slot {slot['slot']}, vehicle {role}"
            most_m, what, most_deg, most_past_m = BARS[options[role]]
            if options["mode"] == "moving":
                # What the strictest of its knots bears.
                most_m, most_deg, what = *slot["bears_" + role], "axis"
                print(f"     {name}: its knots bear {most_m:.2f} m, {most_deg:.2f} deg")
            position = slot["pos_" + role][0]
            bar(f"{name}: position rms, m", position, position <= most_m)
            if what:
                off = slot[f"{what}_{role}"][0]
                bar(f"{name}: {what} rms, deg", off, off <= most_deg)
            if slot["past_" + role] is not None:
                bar(f"{name}: past its pose, m", slot["past_" + role], slot["past_" + role] <= most_past_m)
            seconds = slot["on_" + role] / end["missions"]
            # J is on half a guard before and after; 0.2 s before where it comes from another user.
            beside_s = 0.0 if role == "i" else 0.1 if options["mode"] and slot["slot"] > 0 else 0.5
            bar(f"{name}: on the air, s", round(seconds, 2), seconds >= slot_s - 1.1 + beside_s)
else:
    # Nothing goes wrong on a flight that was none.
    for role in "ij":
        bar(f"vehicle {role}: flew", score["modes_" + role][-1], any(mode[2] == "armed" for mode in score["modes_" + role]))
    planned = options["do"][0].split("=>", 1)[1].split("&")[0]
    done = [event[0] for event in score.get("after", [])]
    bar("went wrong", done, planned in done)
    for role in "ij":
        print("    ", role, "modes", score["modes_" + role], "ended", score["end_" + role])
    for event in score.get("after", []):
        print("     silent after", event[0], event[1])
sys.exit(1 if bad else 0)
