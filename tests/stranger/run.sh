#!/bin/sh
# Builds the software vehicle and lets pymavlink, as a stranger, fly it with both firmware faces; then flies a small
# mission and lets pymavlink read its logs.
# Needs cargo and python3 with venv. SPEED (default 5) is simulated seconds per second, PORT (default 14560) a free
# UDP port on this machine, VENV where the Python environment is kept.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
speed=${SPEED:-5}
port=${PORT:-14560}
venv=${VENV:-$root/target/stranger-venv}

# The profile of the tests: optimised, and built already where the tests have run.
cargo build --profile test --manifest-path "$root/Cargo.toml" --package veilwing-sitl --bin veilwing-sitl \
    --package veilwing --bin veilwing
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

logs=$(mktemp -d)
trap '[ -z "$pid" ] || kill "$pid" 2>/dev/null || true; rm -rf "$logs"' EXIT INT TERM
echo "== a flight's logs"
"${CARGO_TARGET_DIR:-$root/target}/debug/veilwing" sitl "$root/tests/flight/yard.toml" --speed "$speed" --out "$logs" \
    2>"$logs/progress.log" || { cat "$logs/progress.log" >&2; exit 1; }
for vehicle in i j; do
    "$venv/bin/python" "$here/read_tlog.py" "$logs/$vehicle-autopilot.tlog"
    "$venv/bin/python" "$here/read_tlog.py" "$logs/$vehicle-pair.tlog" \
        --definitions "$root/message_definitions/veilwing.xml"
done
echo "every log of a flight read by a stranger"
