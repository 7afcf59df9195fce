#!/usr/bin/env bash
# The bridge script: syntax, then its behaviour against a stand-in for ArduPilot. Needs lua5.3, as ArduPilot runs it;
# installs it where apt-get can.
set -euo pipefail
cd "$(dirname "$0")/../.."
if ! command -v lua5.3 >/dev/null || ! command -v luac5.3 >/dev/null; then
    sudo=$([ "$(id -u)" = 0 ] || echo sudo)
    { $sudo apt-get update -q && $sudo apt-get install -y --no-install-recommends lua5.3; } >/dev/null || {
        echo "lua5.3 is missing and could not be installed" >&2
        exit 1
    }
fi
for file in ardupilot/*.lua ardupilot/test/*.lua; do
    luac5.3 -p "$file"
done
lua5.3 ardupilot/test/run.lua
