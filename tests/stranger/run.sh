#!/bin/sh
# Builds the software vehicle and lets pymavlink, as a stranger, fly it with both firmware faces.
# Needs cargo and python3 with venv. SPEED (default 5) is simulated seconds per second, PORT (default 14560) a free
# UDP port on this machine, VENV where the Python environment is kept.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
speed=${SPEED:-5}
port=${PORT:-14560}
venv=${VENV:-$root/target/stranger-venv}

cargo build --manifest-path "$root/Cargo.toml" --package veilwing-sitl --bin veilwing-sitl
vehicle=${CARGO_TARGET_DIR:-$root/target}/debug/veilwing-sitl
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"

pid=
trap '[ -z "$pid" ] || kill "$pid" 2>/dev/null || true' EXIT INT TERM
for firmware in px4 ardupilot; do
    echo "== $firmware"
    "$vehicle" vehicle --link "udpout:127.0.0.1:$port" --firmware "$firmware" --speed "$speed" &
    pid=$!
    "$venv/bin/python" "$here/fly.py" --link "udpin:127.0.0.1:$port" --speed "$speed"
    kill "$pid"
    wait "$pid" || [ $? -eq 130 ]
    pid=
done
echo "both firmware faces flown by a stranger"
