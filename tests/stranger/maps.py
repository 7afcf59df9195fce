#!/usr/bin/env python3
"""Maps of a plan and of a flight, read by programs of others: geojson, pykml with OGC's own schema, fastkml, and MAVSDK's import of
QGroundControl plans.

A software vehicle must be there, since MAVSDK imports plans for a vehicle that it has found:

    veilwing-sitl vehicle --link udpout:127.0.0.1:14550 --firmware px4
    maps.py --program VEILWING --root TREE --port 14550

Exits 0 if every check holds, 1 otherwise.
"""

import argparse
import asyncio
import math
import pathlib
import subprocess
import tempfile
import tomllib

import geojson
from check import check, run
from fastkml import KML
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from pykml.parser import Schema, parse

METRES_A_DEGREE = 111_229.0  # of latitude, at 50 degrees north


def metres(origin, lat_deg, lon_deg):
    """East and north of the origin, near enough over a courtyard."""
    north = (lat_deg - origin["lat_deg"]) * METRES_A_DEGREE
    east = (lon_deg - origin["lon_deg"]) * METRES_A_DEGREE * math.cos(math.radians(origin["lat_deg"])) * 1.0023
    return east, north


def near(a, b):
    return math.dist(a, b) < 0.5


def read_geojson(path, mission, flown):
    with open(path, encoding="utf-8") as file:
        collection = geojson.load(file)
    check(isinstance(collection, geojson.FeatureCollection) and collection.is_valid, f"geojson: {path.name} is valid")
    features = collection["features"]
    check(all(f.is_valid and f["geometry"].is_valid for f in features), f"geojson: each of {len(features)} features is valid")
    origin = mission["mission"]["origin"]
    of = lambda kind: [f for f in features if f["properties"]["kind"] == kind]
    (area,) = of("area")
    ring = area["geometry"]["coordinates"][0]
    corners = [metres(origin, lat, lon) for lon, lat in ring]
    wanted = mission["airspace"]["area_enu_m"]
    check(corners[0] == corners[-1] and len(corners) == len(wanted) + 1, "geojson: the area's ring is closed")
    twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, corners[1:]))
    check(twice > 0, "geojson: the area's ring is counter-clockwise")
    check(all(any(near(c, w) for w in wanted) for c in corners), "geojson: the area lies where the mission has it")
    for kind in ("user", "eavesdropper"):
        found = {f["properties"]["name"]: f for f in of(kind)}
        check(set(found) == {node["name"] for node in mission[kind]}, f"geojson: every {kind} is there: {', '.join(found)}")
        for node in mission[kind]:
            lon, lat = found[node["name"]]["geometry"]["coordinates"]
            # The world's own users and eavesdroppers are elsewhere in their discs.
            check(flown or near(metres(origin, lat, lon), node["enu_m"][:2]), f"geojson: {node['name']} is in its place")
    check(len(of("pose")) == 2 * len(mission["user"]), "geojson: both vehicles' pose for every user")
    check(len(of("track")) == (2 if flown else 0), f"geojson: {len(of('track'))} tracks")


def read_kml(path, schema, mission, flown):
    with open(path, encoding="utf-8") as file:
        document = parse(file)
    schema.assertValid(document.getroot())
    check(True, f"pykml: {path.name} is valid by OGC's schema of KML 2.2")
    names = [str(name) for name in document.getroot().iter("{http://www.opengis.net/kml/2.2}name")]
    wanted = [node["name"] for kind in ("user", "eavesdropper") for node in mission[kind]]
    check(all(name in names for name in wanted), f"pykml: {', '.join(wanted)} are named")
    (top,) = KML.parse(str(path), strict=True).features
    folders = [folder for folder in top.features if hasattr(folder, "features")]
    placemarks = [mark for folder in folders for mark in folder.features]
    check(all(mark.geometry is not None for mark in placemarks), f"fastkml: {len(placemarks)} placemarks have a place")
    lines = [mark for mark in placemarks if mark.geometry.geom_type == "LineString"]
    check(len(lines) == (2 if flown else 0), f"fastkml: {len(lines)} lines")


async def read_plans(paths, mission, port):
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        check(system is not None, f"MAVSDK {await mavsdk.version()} finds the vehicle")
        missions = MissionRawAsync(system)
        origin = mission["mission"]["origin"]
        for path in paths:
            found = await missions.import_qgroundcontrol_mission(str(path))
            waypoints = [item for item in found.mission_items if item.command == 16]
            check(len(waypoints) == len(mission["user"]), f"MAVSDK: {path.name} has a waypoint for each slot")
            low, high = mission["airspace"]["altitude_m"]
            heights = [item.z - origin["alt_amsl_m"] for item in waypoints]
            check(all(low - 0.1 <= h <= high + 0.1 for h in heights), "MAVSDK: each lies in the altitude band")
            corners = [metres(origin, item.x * 1e-7, item.y * 1e-7) for item in found.geofence_items]
            wanted = mission["airspace"]["area_enu_m"]
            check(len(corners) == len(wanted), f"MAVSDK: a fence of {len(corners)} corners")
            check(all(any(near(c, w) for w in wanted) for c in corners), "MAVSDK: the fence is the mission's area")
            check(len(found.rally_items) == 1, "MAVSDK: one rally point, above the home")


def program(arguments):
    root = pathlib.Path(arguments.root)
    mission_file = root / "config" / "mission.toml"
    mission = tomllib.loads(mission_file.read_text())
    schema = Schema("ogckml22.xsd")
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        say = lambda *words: subprocess.run(
            [arguments.program, *map(str, words)], check=True, timeout=120, stdout=subprocess.DEVNULL
        )
        say("plan", mission_file, "--out", scratch / "plan")
        say("campaign", mission_file, "--runs", 1, "--out", scratch / "flight")
        flight = next(iter((scratch / "flight").rglob("scene.json"))).parent
        say("report", flight)
        for directory, stem, flown in ((scratch / "plan", "plan", False), (flight, "report", True)):
            read_geojson(directory / f"{stem}.geojson", mission, flown)
            read_kml(directory / f"{stem}.kml", schema, mission, flown)
            plans = [directory / f"{stem}-{role}.plan" for role in "ij"]
            asyncio.run(read_plans(plans, mission, arguments.port))


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--program", required=True, help="veilwing")
parser.add_argument("--root", required=True, help="the tree")
parser.add_argument("--port", type=int, default=14550, help="the vehicle sends to this UDP port of this machine")
parser.add_argument("--speed", type=float, default=1.0, help="the vehicle's --speed")
ARGUMENTS = parser.parse_args()
run(lambda: program(ARGUMENTS), 120.0)
