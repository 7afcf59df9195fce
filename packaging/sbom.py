#!/usr/bin/env python3
"""What a program is made of: its bill of materials (CycloneDX 1.5) and the licences of its parts.

    packaging/sbom.py --target TRIPLE --features LIST --out DIR [--no-default-features]

Writes DIR/sbom.cdx.json and DIR/third-party-licences.txt, by `cargo tree` for that target and those features: what is
linked into the program, not what builds or tests it. Checksums are Cargo.lock's; nothing depends on when it is run. Fails where a
part names no licence; those without a text of their own are listed.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent


def cargo(*words):
    """What cargo says."""
    return subprocess.run(["cargo", *words], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def linked(arguments):
    """Name and version of all that is linked into the program. Not by `cargo metadata`: it turns on every feature that any
    member of the workspace asks for."""
    words = ["tree", "--locked", "--package", "veilwing", "--target", arguments.target, "--prefix", "none"]
    words += ["--edges", "normal,no-proc-macro", "--format", "{p}"]
    words += ["--features", arguments.features] if arguments.features else []
    words += ["--no-default-features"] if arguments.no_default_features else []
    return {(line.split()[0], line.split()[1].removeprefix("v")) for line in cargo(*words).splitlines() if line}


def reference(package):
    """Its name in the world."""
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, checksums):
    """An entry of the bill."""
    entry = {
        "type": "library",
        "bom-ref": reference(package),
        "name": package["name"],
        "version": package["version"],
        "licenses": [{"expression": package["license"].replace("/", " OR ")}],
        "purl": reference(package),
    }
    checksum = checksums.get((package["name"], package["version"]))
    if checksum:
        entry["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    if package["repository"]:
        entry["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    return entry


def texts(package):
    """The licence texts that come with it."""
    directory = pathlib.Path(package["manifest_path"]).parent
    names = ("LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE")
    files = [path for path in directory.iterdir() if path.is_file() and path.name.upper().startswith(names)]
    files += [path for folder in directory.glob("LICENSES") for path in folder.iterdir()]
    return sorted(files)


def main():
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--target", required=True)
    parser.add_argument("--features", default="")
    parser.add_argument("--no-default-features", action="store_true")
    parser.add_argument("--out", required=True, type=pathlib.Path)
    arguments = parser.parse_args()
    known = json.loads(cargo("metadata", "--format-version", "1", "--locked", "--filter-platform", arguments.target))
    packages = {package["id"]: package for package in known["packages"]}
    nodes = {node["id"]: node for node in known["resolve"]["nodes"]}
    in_it = linked(arguments)
    within = {id for id, package in packages.items() if (package["name"], package["version"]) in in_it}
    program = next(package for package in packages.values() if package["name"] == "veilwing")
    parts = sorted(within - {program["id"]}, key=lambda id: reference(packages[id]))
    needs = {
        id: sorted(
            part["pkg"]
            for part in nodes[id]["deps"]
            if part["pkg"] in within and any(kind["kind"] is None for kind in part["dep_kinds"])
        )
        for id in within
    }
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    checksums = {(package["name"], package["version"]): package.get("checksum") for package in lock["package"]}
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {**component(program, checksums), "type": "application"},
            "properties": [
                {"name": "veilwing:target", "value": arguments.target},
                {"name": "veilwing:features", "value": arguments.features or "default"},
            ],
        },
        "components": [component(packages[id], checksums) for id in parts],
        "dependencies": [
            {
                "ref": reference(packages[id]),
                "dependsOn": [reference(packages[need]) for need in needs[id]],
            }
            for id in [program["id"], *parts]
        ],
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "sbom.cdx.json").write_text(json.dumps(bill, indent=1) + "\n")
    foreign = [packages[id] for id in parts if packages[id]["source"]]
    # Each text once, with all that come with it.
    by_text = {}
    for package in foreign:
        for path in texts(package):
            by_text.setdefault(path.read_text(errors="replace").strip(), []).append(package["name"])
    named = {name for names in by_text.values() for name in names}
    missing = [package for package in foreign if package["name"] not in named]
    with (arguments.out / "third-party-licences.txt").open("w") as notices:
        for package in foreign:
            where = package["repository"] or package["homepage"] or ""
            authors = "; ".join(package["authors"])
            notices.write(f"{package['name']} {package['version']}: {package['license']}  {where}  {authors}\n")
        for text, names in by_text.items():
            notices.write(f"\n{'=' * 78}\n{', '.join(dict.fromkeys(names))}\n{'-' * 78}\n{text}\n")
    print(f"{len(parts)} parts; {len(missing)} come without a text of their own: {', '.join(p['name'] for p in missing) or 'none'}")
    unlicensed = [packages[id]["name"] for id in parts if not packages[id]["license"]]
    if unlicensed:
        sys.exit(f"no licence: {', '.join(unlicensed)}")


if __name__ == "__main__":
    main()
