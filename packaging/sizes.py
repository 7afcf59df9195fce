#!/usr/bin/env python3
"""How much the packages take: bytes, memory, and the time from the start to a plan.

    packaging/sizes.py [DIRECTORY_OF_PACKAGES]

Prints a table of what packaging/build.sh has made. Start and memory are those of `veilwing fly` on the demo mission, from the
onboard tarball, up to the READY=1 that it tells its service manager. The other architecture than this computer's runs under qemu:
its times are qemu's, its memory has the emulator's in it.
"""

import os
import pathlib
import platform
import socket
import subprocess
import sys
import tarfile
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
KINDS = {
    "amd64": ("x86_64-unknown-linux-gnu", "x86_64", []),
    "arm64": ("aarch64-unknown-linux-gnu", "aarch64", ["qemu-aarch64-static", "-L", "/usr/aarch64-linux-gnu"]),
}
VEHICLE = """
[vehicle]
role = "i"
[autopilot]
link = "udpout:127.0.0.1:9"
[pair]
link = "udpout:127.0.0.1:9"
[log]
dir = "{}"
"""


def started(program, directory):
    """Seconds to READY=1, and resident KiB then."""
    vehicle = directory / "vehicle.toml"
    vehicle.write_text(VEHICLE.format(directory / "logs"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(directory / "notify"))
        manager.settimeout(120)
        environment = {**os.environ, "NOTIFY_SOCKET": str(directory / "notify")}
        began = time.monotonic()
        companion = subprocess.Popen(
            [*program, "fly", ROOT / "config/mission.toml", "--vehicle", vehicle],
            env=environment,
            stderr=subprocess.DEVNULL,
        )
        try:
            while b"READY=1" not in manager.recv(4096):
                pass
            seconds = time.monotonic() - began
            status = pathlib.Path(f"/proc/{companion.pid}/status").read_text()
            return seconds, int(status.split("VmRSS:")[1].split()[0])
        finally:
            companion.terminate()
            companion.wait()
            (directory / "notify").unlink()


def main():
    """See the module."""
    packages = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/packaging/out")
    print("architecture  onboard.deb  desk.deb  program  start to plan  resident")
    for architecture, (triple, machine, emulator) in KINDS.items():
        debs = [list(packages.glob(f"{name}_*_{architecture}.deb")) for name in ("veilwing", "veilwing-desk")]
        if not all(debs):
            continue
        sizes = [found[0].stat().st_size / 2**20 for found in debs]
        with tempfile.TemporaryDirectory() as directory:
            directory = pathlib.Path(directory)
            tarball = next(path for path in packages.glob(f"veilwing-*-{triple}.tar.gz") if "desk" not in path.name)
            with tarfile.open(tarball) as archive:
                archive.extractall(directory, filter="data")
            program = next(directory.glob("*/usr/bin/veilwing"))
            runner = [] if platform.machine() == machine else emulator
            seconds, resident = started([*runner, program], directory)
            size = program.stat().st_size / 2**20
        where = " (under qemu)" if runner else ""
        print(
            f"{architecture:12}  {sizes[0]:7.1f} MiB  {sizes[1]:4.1f} MiB {size:4.1f} MiB  {seconds:11.2f} s  "
            f"{resident / 1024:4.1f} MiB{where}"
        )


if __name__ == "__main__":
    main()
