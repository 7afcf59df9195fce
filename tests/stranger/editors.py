#!/usr/bin/env python3
"""taplo and tombi, behind most editors' TOML plugins, judge the shipped files by their schemas.

Both accept every shipped file as it is, and refuse each of a dozen mistakes, planted one at a time, at its line.

    editors.py --root TREE --bin DIRECTORY_OF_THE_TOOLS

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import json
import os
import pathlib
import platform
import re
import shutil
import subprocess
import tempfile

from check import check, run

# File, what stands there, the mistake, what the mistaken line holds then.
MISTAKES = [
    ("mission.toml", "guard_s = 1.0", "gaurd_s = 1.0", "gaurd_s"),
    ("mission.toml", "slot_s = 10.0", "slot_s = -10.0", "slot_s = -10.0"),
    ("mission.toml", 'name = "courtyard"', "name = 5", "name = 5"),
    ("mission.toml", 'method = "veilwing"', 'method = "vielwing"', "vielwing"),
    ("mission.toml", "enu_m = [15.0, 8.0, 1.5]", "enu_m = [15.0, 8.0]", "enu_m = [15.0, 8.0]"),
    ("mission.toml", "altitude_m = [20.0, 80.0]", 'altitude_m = ["20", 80.0]', 'altitude_m = ["20"'),
    ("mission.toml", "[tdma]", "[tmda]", "[tmda]"),
    ("mission.toml", "lat_deg = 50.0755, lon_deg", "lat_deg = 150.0755, lon_deg", "lat_deg = 150"),
    ("vehicle-i.toml", 'role = "i"', 'role = "k"', 'role = "k"'),
    ("vehicle-j.toml", "[pair]", "[pair]\nlnik = 1", "lnik"),
    ("radio.toml", "system_id = ", "system_id = 300 # ", "system_id = 300"),
    ("faults.toml", 'kind = "companion-kill"', 'kind = "meteor"', "meteor"),
]


def plain(text):
    """Without colours."""
    return re.sub("\x1b\\[[0-9;]*m", "", text)


class Taplo:
    name = "taplo"

    def __init__(self, tools):
        self.program = tools / "taplo"

    def judge(self, path):
        """Whether the file passes, and the lines that are complained of."""
        done = subprocess.run(
            [self.program, "lint", "--colors", "never", path], capture_output=True, text=True, timeout=60,
            env={**os.environ, "RUST_LOG": "info"},
        )
        said = plain(done.stdout + done.stderr)
        # It passes a file whose schema it has not found as well.
        lines = [int(line) for line in re.findall(re.escape(path.name) + r":(\d+):\d+", said)]
        return done.returncode == 0, lines, said


class Tombi:
    name = "tombi"

    def __init__(self, tools):
        self.program = tools / "tombi"

    def judge(self, path):
        done = subprocess.run(
            [self.program, "lint", "--offline", path], capture_output=True, text=True, timeout=60,
            env={**os.environ, "NO_COLOR": "1"},
        )
        said = plain(done.stdout + done.stderr)
        lines = [int(line) for line in re.findall(re.escape(path.name) + r":(\d+):\d+", said)]
        return done.returncode == 0, lines, said


def program(arguments):
    root = pathlib.Path(arguments.root)
    tools = pathlib.Path(arguments.bin)
    judges = [Tombi(tools)]
    if platform.machine() == "x86_64":
        judges.append(Taplo(tools))
    else:
        print(f"taplo has no wheel for {platform.machine()}: tombi judges alone", flush=True)
    shipped = sorted(root.glob("config/*.toml")) + sorted(root.glob("packaging/etc/*.toml"))
    check(len(shipped) >= 9, f"{len(shipped)} files are shipped")
    for judge in judges:
        for path in shipped:
            accepted, _, said = judge.judge(path)
            check(accepted, f"{judge.name} accepts {path.relative_to(root)}" if accepted else said)
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        shutil.copytree(root / "config" / "schema", scratch / "schema")
        for number, (name, right, wrong, mark) in enumerate(MISTAKES):
            text = (root / "config" / name).read_text()
            check(right in text, f"config/{name} has {right!r}")
            path = scratch / f"{number}-{name}"
            path.write_text(text.replace(right, wrong, 1))
            lines = path.read_text().splitlines()
            planted = 1 + next(at for at, line in enumerate(lines) if mark in line)
            for judge in judges:
                accepted, complained, said = judge.judge(path)
                check(not accepted, f"{judge.name} refuses {wrong!r}" if not accepted else said)
                check(planted in complained, f"{judge.name} places it at line {planted}" if planted in complained else said)
        check(
            all(json.loads(path.read_text())["$schema"].endswith("draft-07/schema#") for path in scratch.glob("schema/*.json")),
            "every schema is of draft-07",
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", required=True, help="the tree")
    parser.add_argument("--bin", required=True, help="where taplo and tombi are")
    parsed = parser.parse_args()
    run(lambda: program(parsed), 120)
