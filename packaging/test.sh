#!/usr/bin/env bash
# The packages where they are to live: a Debian of its own (debootstrap) with systemd as its first process (systemd-nspawn).
#
#     packaging/test.sh [DIRECTORY_OF_PACKAGES]
#
# Installs the onboard package; looks at its units; flies a whole mission by `systemctl start`, both companions over
# pseudo-terminals as serial lines to software vehicles, one of them with its transmitter behind the packaged radio host; stops a
# companion on purpose while it is on the air, and shows by the journal that the radio was silent before the watchdog killed it;
# kills and stops the radio host; upgrades, removes and purges. Each step prints what it saw, with its figure.
#
# Needs root, this computer's architecture among the packages (packaging/build.sh), and a Debian mirror ($MIRROR). Its Debian is
# kept in target/packaging/debian. Takes about five minutes, most of them two flights in real time.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "$(id -u)" != 0 ]; then
    echo "skipped: packaging/test.sh needs root, for a Debian of its own"
    exit 0
fi
packages=${1:-target/packaging/out}
first=
here=$PWD/target/packaging
base=$here/debian
root=$here/debian-tried
mirror=${MIRROR:-http://deb.debian.org/debian}
architecture=$(dpkg --print-architecture)
deb=$(ls "$packages"/veilwing_*_"$architecture".deb)
desk=$(ls "$packages"/veilwing-desk_*_"$architecture".deb)

say() { printf '\n-- %s (%s s)\n' "$*" "$SECONDS"; }
ok() { printf 'ok   %s\n' "$*"; }
fail() {
    [ -z "$first" ] || inside journalctl --no-pager -q -o short-precise -t systemd -t veilwing -t veilwing-sitl -t socat -n 60 >&2 || true
    printf 'FAIL %s\n' "$*" >&2
    exit 1
}

missing=()
for tool in debootstrap:debootstrap systemd-nspawn:systemd-container nsenter:util-linux; do
    command -v "${tool%%:*}" >/dev/null || missing+=("${tool#*:}")
done
if [ ${#missing[@]} -gt 0 ]; then
    apt-get update -q >/dev/null
    DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}" >/dev/null
fi

container=
end() {
    # Its first process takes all others with it; the container's own ends by itself then.
    local inner
    inner=$([ -z "$container" ] || pgrep -P "$container" || true)
    [ -z "$inner" ] || kill -KILL "$inner" 2>/dev/null || true
    [ -z "$container" ] || wait "$container" 2>/dev/null || true
    rm -rf "$root"
}
trap end EXIT
trap 'exit 130' INT TERM

say "a Debian"
if [ ! -e "$base/.done" ]; then
    rm -rf "$base"
    # util-linux and procps for what an operator types; socat for the serial lines; adduser is the package's.
    debootstrap --variant=minbase --include=systemd,systemd-sysv,adduser,socat,procps,man-db bookworm "$base" "$mirror" >"$here/debootstrap.log" 2>&1 ||
        { tail "$here/debootstrap.log" >&2; exit 1; }
    rm -f "$base"/var/cache/apt/archives/*.deb
    touch "$base/.done"
fi
rm -rf "$root"
cp -a "$base" "$root"
systemd-nspawn --quiet --directory "$root" --boot --keep-unit --register=no --private-network --console=pipe \
    >"$here/nspawn.log" 2>&1 </dev/null &
container=$!

# inside COMMAND...: in the Debian, beside its systemd.
inside() { nsenter --target "$first" --all -- "$@"; }
for _ in $(seq 100); do
    first=$(pgrep -P "$container" | head -n 1 || true)
    [ -n "$first" ] && inside systemctl is-system-running 2>/dev/null | grep -qE 'running|degraded' && break
    first=
    sleep 0.2
done
[ -n "$first" ] || { cat "$here/nspawn.log" >&2; echo "FAIL its systemd does not start" >&2; exit 1; }
ok "$(inside systemctl --version | head -n 1)"

# until_journal UNIT TEXT SECONDS: waits for a line, and prints the time of it in seconds.
until_journal() {
    local end=$((SECONDS + $3)) found
    while [ $SECONDS -lt $end ]; do
        found=$(inside journalctl --no-pager -q -u "$1" -o short-unix --since "@$since" | grep -m 1 -F -e "$2" || true)
        [ -z "$found" ] || { echo "${found%% *}"; return 0; }
        sleep 0.2
    done
    fail "$1 does not say \"$2\" in $3 s"
}
now() { date +%s.%N; }
minus() { awk "BEGIN { printf \"%.3f\", $1 - $2 }"; }

say "install"
cp "$deb" "$root/opt/veilwing.deb"
inside dpkg -i /opt/veilwing.deb >"$here/install.log" 2>&1 || { cat "$here/install.log" >&2; fail "it cannot be installed"; }
ok "$(inside veilwing --version)"
inside id veilwing
for unit in veilwing@i.service veilwing-radio.service; do
    [ "$(inside systemctl is-enabled "$unit" || true)" = disabled ] || fail "$unit is enabled by the installation"
    [ "$(inside systemctl is-active "$unit" || true)" = inactive ] || fail "$unit is started by the installation"
done
ok "nothing is enabled, nothing started"
for name in veilwing veilwing-fly veilwing-radio veilwing-check veilwing-plan; do
    [ -s "$root/usr/share/man/man1/$name.1.gz" ] || fail "no manual page $name"
done
inside bash -n /usr/share/bash-completion/completions/veilwing
ok "manual pages and completions"

say "units"
inside systemd-analyze verify veilwing@i.service veilwing@j.service veilwing-radio.service 2>"$here/verify.log" || { cat "$here/verify.log" >&2; fail "systemd-analyze verify"; }
[ ! -s "$here/verify.log" ] || { cat "$here/verify.log" >&2; fail "systemd-analyze verify has remarks"; }
ok "systemd-analyze verify: nothing to say"
for unit in veilwing@i.service veilwing-radio.service; do
    score=$(inside systemd-analyze security --no-pager "$unit" | sed -n 's/.*Overall exposure level.*: \([0-9.]* [A-Z]*\).*/\1/p')
    ok "systemd-analyze security: $unit $score"
    [ "$(awk "BEGIN { print (${score%% *} <= 2.0) }")" = 1 ] || fail "$unit is exposed more than that"
done
for role in i j; do
    inside runuser -u veilwing -- veilwing check /etc/veilwing/mission.toml --vehicle "/etc/veilwing/vehicle-$role.toml" >/dev/null || fail "the conffiles do not pass check"
done
ok "the conffiles pass check"

say "the radio host alone"
since=$(date +%s)
inside systemctl start veilwing-radio || fail "the radio host does not start"
until_journal veilwing-radio.service "radio: off" 10 >/dev/null
inside systemctl show -p StatusText veilwing-radio
radio=$(inside systemctl show -p MainPID --value veilwing-radio)
inside kill -KILL "$radio"
sleep 1
[ "$(inside systemctl is-active veilwing-radio)" = active ] || fail "the radio host is not started again after SIGKILL"
radio=$(inside systemctl show -p MainPID --value veilwing-radio)
stopped=$(now)
inside kill -STOP "$radio"
killed=$(until_journal veilwing-radio.service "Watchdog timeout" 6)
sleep 1
[ "$(inside systemctl is-active veilwing-radio)" = active ] || fail "the radio host is not started again after its watchdog"
ok "killed: started again; stopped (SIGSTOP): killed by its watchdog $(minus "$killed" "$stopped") s later, started again"

# The mission, as an operator edits conffiles: the yard, a start by the clock, and serial lines.
say "two software vehicles on serial lines"
dpkg-deb --extract "$desk" "$here/desk"
install -m 755 "$here/desk/usr/bin/veilwing-sitl" "$root/usr/local/bin/"
rm -rf "$here/desk"
# Anew for each flight: a line that nobody reads keeps what was said meanwhile, and is late with all that follows.
flight=0
vehicles() {
    local role number home
    inside systemctl stop --quiet 'line-*' 'vehicle-*' || true
    flight=$((flight + 1))
    for role in i j; do
        number=$([ $role = i ] && echo 1 || echo 2)
        # Home of the yard's vehicles: [-8, 0] and [8, -20] m east and north of its origin.
        home=$([ $role = i ] && echo 50.0755,14.4376881,200 || echo 50.0753202,14.4379119,200)
        inside systemd-run --quiet --collect --unit "vehicle-$role-$flight" \
            veilwing-sitl vehicle --link "udpin:127.0.0.1:1466$number" --system-id "$number" --home "$home"
        inside systemd-run --quiet --collect --unit "line-$role-$flight" --property Restart=always --property RestartSec=100ms \
            socat -b 2048 "pty,rawer,wait-slave,link=/run/vehicle-$role,group=dialout,mode=660" "udp:127.0.0.1:1466$number"
    done
}
files=$root/etc/veilwing
# Both are omnicopters with a leased radio; J's own example is an ArduCopter.
sed -e 's|^role = "i"|role = "j"|' -e 's|^system_id = 1 |system_id = 2 |' -e 's|^peer_system_id = 2 |peer_system_id = 1 |' \
    -e 's|^link = "serial:[^"]*"|link = "serial:/run/vehicle-j:921600"|' \
    -e 's|^link = "udp[^"]*:14600"|link = "udpin:127.0.0.1:14600"|' "$files/vehicle-i.toml" >"$files/vehicle-j.toml"
sed -i -e 's|^link = "serial:[^"]*"|link = "serial:/run/vehicle-i:921600"|' \
    -e 's|^link = "udp[^"]*:14600"|link = "udpout:127.0.0.1:14600"|' "$files/vehicle-i.toml"
# I's transmitter is behind the packaged radio host.
sed -i 's|^# link = "serial:/dev/ttyUSB0:57600" .*|link = "udpout:127.0.0.1:14570"|' "$files/vehicle-i.toml"
grep -q '^link = "udpout:127.0.0.1:14570"' "$files/vehicle-i.toml" || fail "vehicle-i.toml has no [transmitter] link to change"
# Pseudo-terminals are not among the devices that the unit opens.
for role in i j; do
    mkdir -p "$root/etc/systemd/system/veilwing@$role.service.d"
    printf '[Service]\nDeviceAllow=char-pts rw\n' >"$root/etc/systemd/system/veilwing@$role.service.d/line.conf"
done
inside systemctl daemon-reload

# mission SECONDS_FROM_NOW
mission() {
    sed "s|^\\[tdma\\]|[tdma]\\nstart_utc = $(date -u -d "@$(($(date +%s) + $1))" +%Y-%m-%dT%H:%M:%SZ)|" \
        tests/flight/yard.toml >"$root/etc/veilwing/mission.toml"
}

say "a flight, by systemctl start"
since=$(date +%s)
vehicles
mission 45
began=$(now)
inside systemctl start veilwing@i veilwing@j || fail "they do not start"
ok "both started and ready (plan made, links open) after $(minus "$(now)" "$began") s"
until_journal veilwing@i.service "slot 0: on" 120 >/dev/null
inside systemctl show -p StatusText --value veilwing@i veilwing@j
[ -n "$(inside journalctl -q --no-pager -u veilwing@i VEILWING_PHASE=slot VEILWING_ROLE=I)" ] || fail "the journal does not know phases by field"
memory=$(awk '/VmRSS/ { print $2 }' "/proc/$(pgrep -n -f 'fly /etc/veilwing/mission.toml --vehicle /etc/veilwing/vehicle-i.toml')/status")
for role in i j; do
    until_journal "veilwing@$role.service" "landed and disarmed" 150 >/dev/null
done
sleep 1
for role in i j; do
    result=$(inside systemctl show -p Result,ExecMainStatus --value "veilwing@$role" | tr '\n' ' ')
    [ "$result" = "success 0 " ] || fail "veilwing@$role ended with: $result"
done
ok "both missions completed, landed and disarmed; $memory KiB resident in the slot"
inside journalctl -q --no-pager -u veilwing@i -o cat --since "@$since" | grep -E '^slot|mission|landed|airborne' || true
find "$root/var/lib/veilwing" -name '*.tlog' -size +10k | grep -q . || fail "no telemetry logs under /var/lib/veilwing"

say "the watchdog, on the air"
# A start by the clock counts once for a vehicle; here nobody is at a ground station to say it again.
find "$root/var/lib/veilwing" -name '*.orders' -delete
since=$(date +%s)
vehicles
mission 45
inside systemctl start veilwing@i veilwing@j || fail "they do not start"
until_journal veilwing@i.service "slot 0: on" 120 >/dev/null
sleep 1
companion=$(inside systemctl show -p MainPID --value veilwing@i)
stopped=$(now)
inside kill -STOP "$companion"
killed=$(until_journal veilwing@i.service "Watchdog timeout" 6)
silent=$(until_journal veilwing-radio.service "the lease ran out; off" 5)
[ "$(awk "BEGIN { print ($silent < $killed && $killed - $stopped < 2.6) }")" = 1 ] || fail "stopped $stopped, silent $silent, killed $killed"
ok "stopped (SIGSTOP) on the air: its radio silent $(minus "$silent" "$stopped") s later, killed by systemd $(minus "$killed" "$stopped") s later"
sleep 2
[ "$(inside systemctl is-active veilwing@i || true)" = failed ] || fail "veilwing@i was started again"
[ "$(inside systemctl show -p Result --value veilwing@i)" = watchdog ] || fail "veilwing@i ended otherwise"
ok "it is not started again"
began=$(now)
inside systemctl stop veilwing@j
ok "veilwing@j stopped in order in $(minus "$(now)" "$began") s: $(inside systemctl show -p Result --value veilwing@j)"

say "upgrade"
radio=$(inside systemctl show -p MainPID --value veilwing-radio)
before=$(sha256sum "$root"/etc/veilwing/*.toml)
rm -rf "$here/newer"
dpkg-deb --raw-extract "$deb" "$here/newer"
sed -i 's/^Version: .*/&+newer/' "$here/newer/DEBIAN/control"
dpkg-deb --root-owner-group --build "$here/newer" "$root/opt/newer.deb" >/dev/null
rm -rf "$here/newer"
inside dpkg -i /opt/newer.deb >"$here/install.log" 2>&1 </dev/null || { cat "$here/install.log" >&2; fail "it cannot be upgraded"; }
[ "$before" = "$(sha256sum "$root"/etc/veilwing/*.toml)" ] || fail "the upgrade changed files in /etc/veilwing"
[ "$radio" = "$(inside systemctl show -p MainPID --value veilwing-radio)" ] || fail "the upgrade restarted what ran"
ok "to $(inside dpkg-query -W -f '${Version}' veilwing): edited conffiles kept, what runs let alone"

say "remove, purge"
inside dpkg --remove veilwing >"$here/install.log" 2>&1 || { cat "$here/install.log" >&2; fail "it cannot be removed"; }
[ -e "$root/etc/veilwing/vehicle-i.toml" ] && [ ! -e "$root/usr/bin/veilwing" ] || fail "remove leaves the wrong things"
[ "$(inside systemctl is-active veilwing-radio || true)" != active ] || fail "the radio host runs on without its package"
ok "removed: services stopped, conffiles kept"
inside dpkg --purge veilwing >"$here/install.log" 2>&1 || { cat "$here/install.log" >&2; fail "it cannot be purged"; }
[ ! -e "$root/etc/veilwing" ] || fail "purge leaves $(ls "$root/etc/veilwing")"
grep -q '/var/lib/veilwing/flights is not empty and is left' "$here/install.log" || { cat "$here/install.log" >&2; fail "purge says nothing of the flights that it leaves"; }
ok "purged: conffiles gone, flights left and named"
echo "packages tried in $SECONDS s"
