#!/bin/sh
# Real autopilots fly the demo mission as pairs, an independent radio behind each (radio.py, written from docs/radio.md alone), scored
# from the simulators' true poses: PX4's own eight-rotor omnicopter (airframe 10019) in a lockstep simulator of ours; ArduCopter's
# quad, and a canted hexa on its 6DoF frame with ardupilot/veilwing.lua; and one of each in one mission.
#
#     PX4=TREE ARDUPILOT=TREE tests/real/run.sh [PART]...      all without arguments
#
# Parts: px4: calm wind two term kill stop cut mode gps orders transit turning turning-faults moving moving-faults following sih; ArduCopter: quad quad-wind quad-faults six six-faults; both: mixed auto.
# TREE is a source tree with build/px4_sitl_default or build/sitl made in it; without one its parts are skipped, which is said.
# Flights are in real time. RUN (default target/real) is where they are left, VENV the Python environment, REPEAT (default 3) how
# often each is flown. UDP ports 14030 to 14601, 18570 and 24540, TCP 4560 and 5760 with the next ones must be free.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
px4=${PX4:+$PX4/build/px4_sitl_default/bin/px4}
ardupilot=${ARDUPILOT:+$ARDUPILOT/build/sitl/bin/arducopter}
[ -n "$px4$ardupilot" ] || { echo "skipped: neither PX4 nor ARDUPILOT names a source tree that is built"; exit 0; }
for program in $px4 $ardupilot; do
    [ -x "$program" ] || { echo "FAIL there is no $program" >&2; exit 1; }
done
venv=${VENV:-$root/target/stranger-venv}
python=$venv/bin/python
[ -x "$python" ] || {
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps --requirement "$root/tests/stranger/requirements.txt"
}
[ -n "${VEILWING:-}" ] || cargo build --release --manifest-path "$root/Cargo.toml"
VEILWING=${VEILWING:-${CARGO_TARGET_DIR:-$root/target}/release/veilwing}
RUN=${RUN:-$root/target/real}
export VEILWING RUN MAVLINK20=1
mkdir -p "$RUN"
failed=0 flown=0

# fly completed|safe NAME OPTIONS...: one flight and its judgement, REPEAT times.
fly() {
    kind=$1 name=$2
    shift 2
    for n in $(seq "${REPEAT:-3}"); do
        "$python" "$here/pair.py" "$name-$n" --mission "$root/config/mission.toml" "$@" >"$RUN/$name-$n.log" 2>&1 || true
        echo "== $name-$n"
        flown=$((flown + 1))
        "$python" "$here/score.py" "$RUN/$name-$n" --json >"$RUN/$name-$n.json" &&
            "$python" "$here/judge.py" "$RUN/$name-$n" "$kind" <"$RUN/$name-$n.json" || failed=$((failed + 1))
    done
}

# The preflight asks for COM_OBL_RC_ACT beyond 2, and for a GUID_TIMEOUT of a second.
omni() { kind=$1 name=$2; shift 2; fly "$kind" "$name" --set COM_OBL_RC_ACT=5 --timeout 160 "$@"; }
quad() { kind=$1 name=$2; shift 2; fly "$kind" "$name" --i quad --j quad --set GUID_TIMEOUT=1 --timeout 200 "$@"; }
radio="VW_TX_FN=94 VW_DBM_LO=-10 VW_DBM_HI=27"
# Tilted by 12 deg at most J cannot help both users from one place: with optimise = "volume" it would jam for bravo with picowatts.
# shellcheck disable=SC2086  # three words
six() {
    kind=$1 name=$2; shift 2
    fly "$kind" "$name" --i six --j six --altitude 12 22 --settle 5 --optimise rate --bridge-radio --set GUID_TIMEOUT=1 $radio --timeout 240 "$@"
}

on='slot 0: on+3'
way='slot 0 for .*over+3'

[ $# -gt 0 ] || set -- calm wind two term kill stop cut mode gps orders transit turning turning-faults moving moving-faults following quad quad-wind quad-faults six six-faults mixed sih auto
for part in "$@"; do
    case $part in
        quad* | six*) [ -n "$ardupilot" ] || { echo "skipped: $part, ARDUPILOT is not set"; continue; } ;;
        mixed* | auto) [ -n "$px4" ] && [ -n "$ardupilot" ] || { echo "skipped: $part wants PX4 and ARDUPILOT"; continue; } ;;
        *) [ -n "$px4" ] || { echo "skipped: $part, PX4 is not set"; continue; } ;;
    esac
    case $part in
        calm) omni completed calm ;;
        wind) omni completed wind --wind 3.2 -2.4 0 --gust 1 ;;
        two) omni completed two --missions 2 ;;
        term) omni safe term --keep --do "i@$on=>term i" --do 't+45=>pilot i land' ;;
        kill) omni safe kill --keep --do "j@$on=>kill j" --do 'j@slot 0: on+8=>restart j' --do 't+45=>pilot j land' --do 't+60=>term j' ;;
        stop) omni safe stop --keep --do "i@$on=>stop i 3" --do 't+45=>pilot i land' ;;
        cut) omni safe cut --keep --gate --do "i@$on=>cut i 2" --do 't+45=>cmd i 20' ;;
        mode) omni safe mode --keep --do "i@$on=>pilot i hold" --do 't+45=>pilot i land' ;;
        gps) omni safe gps --keep --do "i@$on=>gps i" ;;
        orders)
            omni safe order-kill --keep --do "i@$on=>cmd i 31011"
            omni safe order-return --keep --do "i@$on=>cmd j 20"
            ;;
        transit)
            omni safe way-term --keep --do "i@$way=>term i" --do 't+60=>pilot i land'
            omni safe way-kill --keep --do "j@$way=>kill j" --do 'j@slot 0 for .*over+8=>restart j' --do 't+60=>pilot j land' --do 't+75=>term j'
            omni safe way-stop --keep --do "i@$way=>stop i 3" --do 't+60=>pilot i land'
            omni safe way-cut --keep --gate --do "i@$way=>cut i 2" --do 't+60=>cmd i 20'
            omni safe way-mode --keep --do "i@$way=>pilot i hold" --do 't+60=>pilot i land'
            omni safe way-gps --keep --do "i@$way=>gps i"
            ;;
        turning)
            omni completed turning --mode turning
            omni completed turning-wind --mode turning --wind 3.2 -2.4 0 --gust 1
            ;;
        turning-faults)
            omni safe turning-kill --mode turning --keep --do 'j@slot 1: on+3=>kill j' --do 'j@slot 1: on+8=>restart j' --do 't+55=>pilot j land' --do 't+70=>term j'
            omni safe turning-stop --mode turning --keep --do 'i@slot 1 for .*agreed=>stop i 3' --do 't+55=>pilot i land'
            omni safe turning-cut --mode turning --keep --gate --do 'i@slot 1 for .*agreed=>cut i 2' --do 't+55=>cmd i 20'
            omni safe turning-mode --mode turning --keep --do 'j@slot 1 for .*agreed=>pilot j hold' --do 't+55=>pilot j land'
            ;;
        moving)
            omni completed moving --mode moving
            omni completed moving-wind --mode moving --wind 3.2 -2.4 0 --gust 1
            ;;
        following)
            omni completed follow-walk --optimise rate --slot 30 --area 200 --moves alpha=walks bravo=walks --timeout 300
            omni completed follow-drive --optimise rate --slot 30 --area 200 --moves alpha=walks bravo=drives hill=walks --timeout 300
            ;;
        moving-faults)
            omni safe moving-kill --mode moving --keep --do 'j@slot 1: on+3=>kill j' --do 'j@slot 1: on+8=>restart j' --do 't+55=>pilot j land' --do 't+70=>term j'
            omni safe moving-stop --mode moving --keep --do 'i@slot 1: on+3=>stop i 3' --do 't+55=>pilot i land'
            omni safe moving-cut --mode moving --keep --gate --do 'i@slot 1: on+3=>cut i 2' --do 't+55=>cmd i 20'
            omni safe moving-mode --mode moving --keep --do 'j@slot 1: on+3=>pilot j hold' --do 't+55=>pilot j land'
            ;;
        sih) fly completed sih --i sih --j sih --actuation auto --settle 5 --set COM_OBL_RC_ACT=5 --timeout 240 ;;
        auto)
            omni completed auto-px4 --actuation auto
            quad completed auto-quad --actuation auto
            six completed auto-six --actuation auto
            ;;
        quad) quad completed quad ;;
        quad-wind) quad completed quad-wind --wind 3 -4 0 --gust 1 ;;
        quad-faults)
            quad safe quad-kill --keep --do "i@$on=>kill i" --do 't+60=>pilot i land'
            quad safe quad-term --keep --do "j@$on=>term j" --do 't+60=>pilot j land'
            quad safe quad-stop --keep --do "i@$on=>stop i 3" --do 't+60=>pilot i land'
            quad safe quad-cut --keep --gate --do "i@$on=>cut i 2" --do 't+60=>cmd i 20'
            quad safe quad-mode --keep --do "i@$on=>pilot i hold" --do 't+60=>pilot i land'
            quad safe quad-gps --keep --do "i@$on=>gps i" --do 't+60=>pilot i land'
            quad safe quad-order-kill --keep --do "i@$on=>cmd j 31011"
            quad safe quad-order-return --keep --do "i@$on=>cmd i 20"
            quad safe quad-fence --keep --set GUID_TIMEOUT=1 FENCE_ENABLE=1 FENCE_TYPE=5 FENCE_ALT_MAX=95 --do "i@$on=>push i" --do 't+75=>pilot i land'
            quad safe quad-way-kill --keep --do "i@$way=>kill i" --do 't+60=>pilot i land'
            quad safe quad-way-term --keep --do "i@$way=>term i" --do 't+60=>pilot i land'
            quad safe quad-way-stop --keep --do "i@$way=>stop i 3" --do 't+60=>pilot i land'
            quad safe quad-way-cut --keep --gate --do "i@$way=>cut i 2" --do 't+60=>cmd i 20'
            quad safe quad-way-mode --keep --do "i@$way=>pilot i hold" --do 't+60=>pilot i land'
            quad safe quad-way-gps --keep --do "i@$way=>gps i" --do 't+60=>pilot i land'
            ;;
        six) six completed six --chatter 50 ;;
        six-faults)
            six safe six-script-i --keep --do "i@$on=>param i SCR_VM_I_COUNT 1000" --do 't+90=>pilot i land'
            six safe six-script-j --keep --do "j@$on=>param j SCR_VM_I_COUNT 1000" --do 't+90=>pilot j land'
            six safe six-burst --keep --do "i@$on=>burst i 25"
            six safe six-kill --keep --do "i@$on=>kill i" --do 't+60=>pilot i land'
            six safe six-mode --keep --do "i@$on=>pilot i hold" --do 't+60=>pilot i land'
            six safe six-way-script-i --keep --do "i@$way=>param i SCR_VM_I_COUNT 1000" --do 't+90=>pilot i land'
            ;;
        # shellcheck disable=SC2086  # three words
        mixed) fly completed mixed --i px4 --j six --altitude 12 22 --settle 5 --bridge-radio --set COM_OBL_RC_ACT=5 j:GUID_TIMEOUT=1 j:VW_TX_FN=94 \
            j:VW_DBM_LO=-30 j:VW_DBM_HI=0 --limit speed_m_s=2.5 --timeout 200 ;;
        *) echo "there is no part \"$part\"" >&2; exit 2 ;;
    esac
done
echo "$flown flights, $failed failed"
[ $failed -eq 0 ]
