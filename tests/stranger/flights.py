#!/usr/bin/env python3
"""The MCAP file of a flight, read by the package mcap that comes with the format, and taken apart by Google's protobuf with
nothing but the descriptors in the file; and the replay of its report, run by Node.js.

    flights.py --program VEILWING --root TREE --node NODE

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import collections
import csv
import json
import math
import pathlib
import subprocess
import tempfile
import tomllib

from check import check, run
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

EACH_SAMPLE = ("pose", "location", "antenna", "state", "power")
ONCE_A_SAMPLE = ["/tf", "/radio/sinr", "/radio/secrecy"] + [f"/vehicle_{r}/{k}" for r in "ij" for k in EACH_SAMPLE]
CHANNELS = sorted([*ONCE_A_SAMPLE, "/scene", "/pair/lease", "/events", "/violations"])


def unknown_fields(message):
    """Whether anything in it is unknown to its type."""
    known = {field.number for field, _ in message.ListFields()}
    copy = type(message)()
    copy.ParseFromString(message.SerializeToString())
    copy.DiscardUnknownFields()
    return copy.ByteSize() != message.ByteSize() or not known


def read(path):
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        messages = collections.defaultdict(list)
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            if unknown_fields(decoded) or decoded.DESCRIPTOR.full_name != schema.name:
                raise ValueError(f"{channel.topic}: a message that is not as {schema.name} says")
            messages[channel.topic].append((message.log_time, decoded))
        attachments = {attachment.name: attachment.data for attachment in reader.iter_attachments()}
        (metadata,) = reader.iter_metadata()
    return summary, messages, attachments, metadata.metadata


def judge(flight, path):
    summary, messages, attachments, metadata = read(path)
    topics = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    check(sorted(topics) == CHANNELS, f"mcap: {len(topics)} channels")
    rows = list(csv.DictReader((flight / "timeline.csv").open()))
    events = [json.loads(line) for line in (flight / "events.jsonl").open()]
    broken = [event for event in events if event["kind"] in ("violation", "excused")]
    expected = {topic: len(rows) for topic in ONCE_A_SAMPLE}
    expected |= {"/scene": 1, "/violations": len(broken), "/events": len(events) - len(broken)}
    for topic in sorted(topics):
        count = len(messages[topic])
        check(count == expected.get(topic, count), f"mcap: {count:5} {topics[topic]:24} {topic}")
    check(len(messages["/pair/lease"]) > 10, "mcap: requests, grants and givings up of leases")
    wrong = collections.Counter()
    for k, row in enumerate(rows):
        at = lambda topic: messages[topic][k]
        wrong["times"] += abs(at("/tf")[0] * 1e-9 - float(row["at_s"])) > 1e-6
        for role, transform in zip("ij", at("/tf")[1].transforms):
            place = transform.translation
            there = [float(row[f"{role}_{axis}_m"]) for axis in ("east", "north", "up")]
            wrong["positions"] += math.dist(there, (place.x, place.y, place.z)) > 1e-9
            power = at(f"/vehicle_{role}/power")[1]
            wrong["powers"] += not math.isclose(power.tx_power_w, float(row[f"{role}_power_w"] or 0.0))
            wrong["slots"] += power.slot != int(row[f"{role}_slot"] or -1)
            # The paper's axis: the third column of Rz Ry Rx.
            roll, pitch, yaw = (math.radians(float(row[f"{role}_{a}_deg"])) for a in ("roll", "pitch", "yaw"))
            x = math.cos(roll) * math.sin(pitch)
            axis = (
                math.cos(yaw) * x + math.sin(yaw) * math.sin(roll),
                math.sin(yaw) * x - math.cos(yaw) * math.sin(roll),
                math.cos(roll) * math.cos(pitch),
            )
            said = at(f"/vehicle_{role}/antenna")[1].axis_enu
            wrong["axes"] += math.dist(axis, (said.x, said.y, said.z)) > 1e-6
        rate = at("/radio/secrecy")[1].secrecy_rate_bps
        wrong["rates"] += not math.isclose(rate, float(row["secrecy_rate_bps"] or 0.0))
        wrong["SINR"] += not math.isclose(at("/radio/sinr")[1].user_sinr_linear, float(row["user_sinr"] or 0.0))
    for what, count in sorted(wrong.items()):
        check(count == 0, f"mcap: {what} are the timeline's in all {len(rows)} rows")
    # From the request on the lease lasts; nobody is on the air after it.
    leases = [(time, lease.left_s) for time, lease in messages["/pair/lease"]]
    for time, power in messages["/vehicle_i/power"]:
        if power.on:
            last = [lease for lease in leases if lease[0] <= time][-1]
            wrong["late"] += (time - last[0]) * 1e-9 > last[1]
    check(wrong["late"] == 0, "mcap: whenever I is on the air a lease is in force")
    for name in ("mission.toml", "plan.json", "scene.json", "summary.json"):
        check(attachments.get(name) == (flight / name).read_bytes(), f"mcap: {name} is attached as it is")
    tomllib.loads(attachments["mission.toml"].decode())
    check(metadata["seed"] == "7" and len(metadata["mission_digest"]) == 64, "mcap: seed and the mission's digest")


def program(arguments):
    mission = pathlib.Path(arguments.root) / "config" / "mission.toml"
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        say = lambda *words: subprocess.run(
            [arguments.program, *map(str, words)], check=True, timeout=120, stdout=subprocess.DEVNULL
        )
        say("campaign", mission, "--runs", 1, "--seed", 7, "--out", scratch / "flight")
        flight = next(iter((scratch / "flight").rglob("scene.json"))).parent
        say("report", flight, "--mcap", scratch / "flight.mcap")
        judge(flight, scratch / "flight.mcap")
        replay = pathlib.Path(__file__).with_name("replay.js")
        telemetry = scratch / "telemetry.html"
        say("report", flight, "--telemetry", "--out", telemetry)
        node = subprocess.run([arguments.node, replay, flight / "report.html", telemetry, flight], timeout=60)
        check(node.returncode == 0, "replay: what the page reckons is what the world measured")


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--program", required=True, help="veilwing")
parser.add_argument("--root", required=True, help="the tree")
parser.add_argument("--node", required=True, help="Node.js")
ARGUMENTS = parser.parse_args()
run(lambda: program(ARGUMENTS), 120.0)
