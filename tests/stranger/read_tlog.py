"""Reads a .tlog with pymavlink and prints how many messages of which kind each component sent.

    python3 tests/stranger/read_tlog.py FILE [--definitions message_definitions/veilwing.xml]

Fails on anything that pymavlink cannot read, on a signature, on time that runs backwards, and unless at least two
components speak (a link's log has both directions).
"""
import argparse
import collections
import importlib.util
import os
import pathlib
import sys
import tempfile

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
from pymavlink.generator import mavgen


def use_definitions(xml):
    """Has pymavlink speak the dialect of `xml` instead of its own."""
    with tempfile.TemporaryDirectory() as directory:
        output = os.path.join(directory, "dialect.py")
        options = mavgen.Opts(output, wire_protocol="2.0", language="Python3", validate=False)
        if not mavgen.mavgen(options, [os.path.abspath(xml)]):
            sys.exit(f"pymavlink cannot generate code from {xml}")
        spec = importlib.util.spec_from_file_location("dialect", output)
        dialect = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(dialect)
    # mavutil takes it for granted that every dialect has the common enums.
    for name in vars(mavutil.mavlink):
        if name.startswith("MAV_"):
            vars(dialect).setdefault(name, getattr(mavutil.mavlink, name))
    mavutil.mavlink = dialect


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--definitions", help="XML of the dialect, if not ardupilotmega")
    arguments = parser.parse_args()
    mavutil.set_dialect("ardupilotmega")
    if arguments.definitions:
        use_definitions(arguments.definitions)

    log = mavutil.mavlogfile(str(arguments.file))
    counts = collections.Counter()
    wrong = collections.Counter()
    read_bytes, previous = 0, 0.0
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        if kind == "BAD_DATA":
            wrong["unreadable"] += 1
            continue
        header = message.get_header()
        wrong["signed"] += bool(message.get_signed() or header.incompat_flags & mavutil.mavlink.MAVLINK_IFLAG_SIGNED)
        wrong["time runs backwards"] += message._timestamp < previous
        previous = message._timestamp
        # Each record has a time stamp of eight bytes.
        read_bytes += 8 + len(message.get_msgbuf())
        counts[message.get_srcSystem(), message.get_srcComponent(), kind] += 1
    wrong["bytes not read"] = arguments.file.stat().st_size - read_bytes
    wrong["only one component speaks"] = len({key[:2] for key in counts}) < 2

    for (system, component, kind), count in sorted(counts.items()):
        print(f"{system:3d}/{component:<3d} {kind:32s} {count:8d}")
    faults = {name: count for name, count in wrong.items() if count}
    for name, count in faults.items():
        print(f"FAULT {name}: {int(count)}")
    sys.exit(bool(faults))


main()
