#!/usr/bin/env python3
"""Programs by others have a companion describe its parameters, by component metadata over MAVLink FTP.

Starts `veilwing sitl`, which waits for its start. pymavlink asks both companions where their metadata are, reads the files with
its own MAVLink FTP client, and its Python looks at them: the checksums, the published schemas (of the MAVLink crate's revision),
and each description against the parameter as it is listed. What may not be written or is not there is refused. MAVSDK's component
metadata plugin reads the same by itself. MAVProxy lists and fetches the files, and reads the parameters without delay.

    metadata.py --program target/debug/veilwing --mission tests/flight/yard.toml --schemas DIR --port 14570 --speed 2

Exits 0 if every check holds, 1 otherwise.
"""

import json
import os
import pathlib
import re
import struct
import tempfile
import threading
import time
import zlib

os.environ["MAVLINK20"] = "1"
import jsonschema  # noqa: E402
from check import check, run  # noqa: E402
from companion_flight import COMPANION, OPERATOR, REQUEST_MESSAGE, Flight, Operator, parser  # noqa: E402
from mavsdk import ComponentType, Configuration, Mavsdk  # noqa: E402
from mavsdk.plugins.component_metadata import (  # noqa: E402
    ComponentMetadata,
    ComponentMetadataError,
    MetadataType,
)
from pymavlink import mavftp, mavutil  # noqa: E402

COMPONENT_METADATA = 397
COMP_METADATA_TYPE_PARAMETER = 1
FLOAT = mavutil.mavlink.MAV_PARAM_TYPE_REAL32


def crc(data):
    """MAVLink's CRC-32: zlib's from 0, and the end not inverted."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


class Station:
    """pymavlink, heard by both companions."""

    def __init__(self, port):
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=OPERATOR, dialect="all")
        heard, end = set(), time.monotonic() + 60.0
        while heard != {1, 2} and time.monotonic() < end:
            beat = self.link.recv_match(type="HEARTBEAT", blocking=True, timeout=1.0)
            if beat is not None and beat.get_srcComponent() == COMPANION:
                heard.add(beat.get_srcSystem())
        check(heard == {1, 2}, "pymavlink hears both companions")

    def of(self, system, kind):
        """The next message of a companion."""
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            message = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            if message is not None and (message.get_srcSystem(), message.get_srcComponent()) == (system, COMPANION):
                return message
        check(False, f"companion {system} sends {kind}")
        return None

    def announced(self, system):
        """Where the general file is."""
        self.link.mav.command_long_send(system, COMPANION, REQUEST_MESSAGE, 0, COMPONENT_METADATA, 0, 0, 0, 0, 0, 0)
        # pymavlink's present definitions are without it: a number for a name, and nothing but the frame.
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            message = self.link.recv_match(type=f"UNKNOWN_{COMPONENT_METADATA}", blocking=True, timeout=1.0)
            frame = bytes(message.get_msgbuf()) if message is not None else b""
            if frame[5:7] == bytes((system, COMPANION)):
                # MAVLink 2 leaves out the zeros at the end.
                payload = frame[10 : 10 + frame[1]].ljust(108, b"\0")
                _, file_crc, uri = struct.unpack("<II100s", payload)
                uri = uri.rstrip(b"\0").decode()
                check(uri.startswith("mftp://"), f"companion {system}: its metadata are at {uri}")
                return uri, file_crc
        check(False, f"companion {system} says where its metadata are")
        return None

    def listed(self, system):
        """All parameters by name."""
        self.link.mav.param_request_list_send(system, COMPANION)
        values = {}
        while not values or len(values) < next(iter(values.values())).param_count:
            value = self.of(system, "PARAM_VALUE")
            values[value.param_id] = value
        return values

    def files(self, system):
        """pymavlink's MAVLink FTP client at a companion."""
        return mavftp.MAVFTP(self.link, system, COMPANION)


def fetch(ftp, uri, directory):
    """A file, by pymavlink's client."""
    name = uri.removeprefix("mftp://")
    local = pathlib.Path(directory) / name
    begun = time.monotonic()
    ftp.cmd_get([name, str(local)])
    result = ftp.process_ftp_reply("OpenFileRO", timeout=60)
    check(result.error_code == mavftp.FtpError.Success, f"pymavlink fetches {name} ({result.error_code})")
    data = local.read_bytes()
    check(True, f"{len(data)} bytes in {time.monotonic() - begun:.2f} s")
    return data


def schema(arguments, kind, document):
    """Holds a document against its published schema."""
    published = json.loads((pathlib.Path(arguments.schemas) / f"{kind}.schema.json").read_text())
    validator = jsonschema.Draft7Validator(published)
    errors = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(document)]
    check(errors == [], f"the published {kind}.schema.json is met" + "".join(f"; {text}" for text in errors))


def described(arguments, station, system):
    """A companion's files, whole and as they are published, and its parameters as they say."""
    ftp = station.files(system)
    names = ftp.cmd_list(["/"])
    check(names.error_code == mavftp.FtpError.Success, f"companion {system}: pymavlink lists its files")
    sizes = {entry.name: entry.size_b for entry in names.directory_listing}
    check(set(sizes) == {"general.json", "parameter.json"}, f"which are {sizes}")
    uri, file_crc = station.announced(system)
    with tempfile.TemporaryDirectory() as directory:
        general = fetch(ftp, uri, directory)
        check(crc(general) == file_crc, f"its checksum is the one announced ({file_crc:08x})")
        general = json.loads(general)
        schema(arguments, "general", general)
        types = {entry["type"]: entry for entry in general["metadataTypes"]}
        check(set(types) == {COMP_METADATA_TYPE_PARAMETER}, "it names the parameters' file alone")
        entry = types[COMP_METADATA_TYPE_PARAMETER]
        text = fetch(ftp, entry["uri"], directory)
    check(len(text) == sizes["parameter.json"], "its size is the one listed")
    check(crc(text) == entry["fileCrc"], f"its checksum is the one named ({entry['fileCrc']:08x})")
    check(ftp.cmd_crc(["parameter.json"]).error_code == mavftp.FtpError.Success, "and is told on request")
    parameters = json.loads(text)
    schema(arguments, "parameter", parameters)
    values = station.listed(system)
    check(
        [p["name"] for p in parameters["parameters"]] == list(sorted(values, key=lambda n: values[n].param_index)),
        f"it describes the {len(values)} parameters that are listed, in their order",
    )
    for parameter in parameters["parameters"]:
        name, value = parameter["name"], values[parameter["name"]]
        ranged = parameter.get("min", value.param_value) <= value.param_value <= parameter.get("max", value.param_value)
        kinds = [entry["value"] for entry in parameter.get("values", [])]
        check(
            (parameter["type"], value.param_type) == ("Float", FLOAT)
            and ranged
            and (not kinds or value.param_value in kinds)
            and parameter.get("default", value.param_value) == value.param_value,
            f"{name} = {value.param_value:g} {parameter.get('units', '')}: {parameter['shortDesc']}",
        )
        if parameter["readOnly"]:
            continue
        for wanted, becomes in (
            (parameter["min"], parameter["min"]),
            (parameter["max"] + parameter["increment"], parameter["min"]),
            (parameter["default"], parameter["default"]),
        ):
            station.link.mav.param_set_send(system, COMPANION, name.encode(), wanted, FLOAT)
            now = station.of(system, "PARAM_VALUE").param_value
            check(abs(now - becomes) < 1e-6, f"{name} set to {wanted:g} is {now:g}")
    refused = ftp.cmd_rm(["general.json"])
    error = ftp.process_ftp_reply("RemoveFile").error_code if refused is None else refused.error_code
    check(error == mavftp.FtpError.FileProtected, f"nothing can be removed ({error})")
    missing = ftp.cmd_crc(["../etc/passwd"]).error_code
    check(missing == mavftp.FtpError.FileNotFound, f"nor is anything else there ({missing})")


def by_mavsdk(port):
    """The service as MAVSDK knows it, from the request to the file."""
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    configuration.system_id = OPERATOR
    mavsdk = Mavsdk(configuration)
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    end, systems = time.monotonic() + 30.0, {}
    while time.monotonic() < end and not all(
        k in systems and COMPANION in systems[k].component_ids() for k in (1, 2)
    ):
        systems = {s.get_system_id(): s for s in mavsdk.get_systems()}
        time.sleep(0.1)
    for system in (1, 2):
        check(system in systems, f"MAVSDK sees companion {system}")
        plugin = ComponentMetadata(systems[system])
        came = threading.Event()
        plugin.subscribe_metadata_available(lambda update, _: came.set() if update.compid == COMPANION else None)
        plugin.request_component(COMPANION)
        check(came.wait(40.0), "its plugin is told of the companion's metadata")
        end, text = time.monotonic() + 20.0, None
        while text is None and time.monotonic() < end:
            try:
                text = plugin.get_metadata(COMPANION, MetadataType.PARAMETER).json_metadata
            except ComponentMetadataError:
                time.sleep(0.1)
        names = [p["name"] for p in json.loads(text or "{}").get("parameters", [])]
        check(len(names) >= 10 and "VW_ROLE" in names, f"and has {len(names)} parameters described: {', '.join(names)}")


def by_mavproxy(arguments):
    """As an operator types for them."""
    with Operator(f"udpin:127.0.0.1:{arguments.port}", arguments.port + 1, arguments.speed) as operator:
        operator.both("HEARTBEAT", lambda m: True, 20, "both companions' heartbeats")
        for system in (1, 2):
            begun = time.monotonic()
            operator.parameters(system, system - 1)
            check(time.monotonic() - begun < 15.0, f"MAVProxy: parameters in {time.monotonic() - begun:.1f} s")
        operator.type("module load ftp")
        operator.said("Loaded module ftp|ftp already loaded", 20, "MAVProxy has its module for files", operator.shown)
        operator.type(f"vehicle 2:{COMPANION}")
        operator.type("ftp list")
        operator.said(r"parameter\.json", 20, "MAVProxy lists the files", operator.shown)
        operator.type("ftp get parameter.json fetched.json")
        wrote = operator.said(r"Wrote \d+ bytes", 40, "MAVProxy fetches one", operator.shown)
        size = int(re.search(r"Wrote (\d+) bytes", wrote)[1])
        local, end = pathlib.Path(operator.home.name) / "fetched.json", time.monotonic() + 20.0
        # It says so before it closes the file.
        while not (local.exists() and local.stat().st_size >= size) and time.monotonic() < end:
            time.sleep(0.1)
        names = [p["name"] for p in json.loads(local.read_text())["parameters"]]
        check("VW_ROLE" in names, f"which describes {len(names)} parameters")


def main(arguments):
    with Flight(arguments):
        station = Station(arguments.port)
        for system in (1, 2):
            described(arguments, station, system)
        station.link.close()
    with Flight(arguments):
        by_mavsdk(arguments.port)
    with Flight(arguments):
        by_mavproxy(arguments)


told = parser(__doc__)
told.add_argument("--schemas", required=True, help="directory of the published schemas")
ARGUMENTS = told.parse_args()
run(lambda: main(ARGUMENTS), 420.0)
