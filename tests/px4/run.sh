#!/bin/sh
# The real PX4 flies the demo mission, as a pair: PX4's own eight-rotor omnicopter (airframe 10019) in a lockstep simulator of
# ours, an independent radio behind each (radio.py, written from docs/radio.md alone), scored from the simulator's true poses.
#
#     PX4=TREE tests/px4/run.sh [calm] [wind] [two] [term] [kill] [mode] [gps] [orders]      all without arguments
#
# TREE is a source tree of PX4 with build/px4_sitl_default made in it. Without PX4 nothing is flown, which is said. Flights are in
# real time: nothing else should run. RUN (default target/px4) is where they are left, VENV the Python environment, REPEAT (default
# 3) how often each is flown. UDP ports 14030 to 14601 and 18570, TCP 4560 and 4561 must be free.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
[ -n "${PX4:-}" ] || { echo "skipped: PX4 names no source tree that is built"; exit 0; }
[ -x "$PX4/build/px4_sitl_default/bin/px4" ] || { echo "FAIL no build/px4_sitl_default/bin/px4 in $PX4" >&2; exit 1; }
venv=${VENV:-$root/target/stranger-venv}
python=$venv/bin/python
[ -x "$python" ] || {
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --requirement "$root/tests/stranger/requirements.txt"
}
cargo build --release --manifest-path "$root/Cargo.toml"
VEILWING=${VEILWING:-${CARGO_TARGET_DIR:-$root/target}/release/veilwing}
RUN=${RUN:-$root/target/px4}
export PX4 VEILWING RUN MAVLINK20=1
mkdir -p "$RUN"
failed=0

# fly completed|safe NAME OPTIONS...: one flight and its judgement.
fly() {
    kind=$1 name=$2
    shift 2
    for n in $(seq "${REPEAT:-3}"); do
        "$python" "$here/pair.py" "$name-$n" --mission "$root/config/mission.toml" --set COM_OBL_RC_ACT=5 "$@" \
            >"$RUN/$name-$n.log" 2>&1 || true
        echo "== $name-$n"
        "$python" "$here/score.py" "$RUN/$name-$n" --json >"$RUN/$name-$n.json" &&
            "$python" "$here/judge.py" "$RUN/$name-$n" "$kind" <"$RUN/$name-$n.json" || failed=$((failed + 1))
    done
}

# The pilot's AUTO.LAND, 31 s after MISSION_START, for a vehicle that its companion left in hold.
land() { echo "t+31=>px4cmd $1 176 1 4 6"; }

[ $# -gt 0 ] || set -- calm wind two term kill mode gps orders
for part in "$@"; do
    case $part in
        calm) fly completed calm --timeout 160 ;;
        wind) fly completed wind --timeout 160 --wind 3.2 -2.4 0 --gust 1 ;;
        two) fly completed two --timeout 160 --missions 2 ;;
        term) fly safe term --timeout 130 --keep --do 'i@slot 0: on+3=>term i' --do "$(land i)" ;;
        kill) fly safe kill --timeout 90 --keep --do 'j@slot 0: on+3=>kill j' --do 'j@slot 0: on+8=>restart j' --do "$(land j)" ;;
        mode) fly safe mode --timeout 90 --do 'i@slot 0: on+3=>mode i 4 3' ;;
        gps) fly safe gps --timeout 130 --set COM_OBL_RC_ACT=5 SYS_FAILURE_EN=1 --do 'i@slot 0: on+3=>px4cmd i 420 4 1' ;;
        orders)
            fly safe order-kill --timeout 160 --do 'i@slot 0: on+3=>cmd i 31011'
            fly safe order-return --timeout 160 --do 'i@slot 0: on+3=>cmd j 20'
            ;;
        *) echo "there is no part \"$part\"" >&2; exit 2 ;;
    esac
done
[ "$failed" -eq 0 ] || { echo "$failed flights FAILED"; exit 1; }
echo "px4: $*: every bar held"
