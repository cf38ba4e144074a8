"""Prints what the program track-cpu is made of as CycloneDX 1.5, by cargo's own resolution."""

import hashlib
import json
import os
import subprocess
import tomllib
import uuid
from datetime import datetime, timezone
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TARGETS = ("x86_64-unknown-linux-musl", "aarch64-unknown-linux-musl")


def metadata(target):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def reached(found):
    """The packages that are linked into the program or run while it is built."""
    nodes = {node["id"]: node for node in found["resolve"]["nodes"]}
    root = found["resolve"]["root"]
    edges, pending = {}, [root]
    while pending:
        package = pending.pop()
        if package in edges:
            continue
        edges[package] = [
            dependency["pkg"]
            for dependency in nodes[package]["deps"]
            if any(kind["kind"] != "dev" for kind in dependency["dep_kinds"])
        ]
        pending.extend(edges[package])
    return root, edges


def main():
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    checksums = {(p["name"], p["version"]): p.get("checksum") for p in lock["package"]}
    packages, edges = {}, {}
    for target in TARGETS:
        found = metadata(target)
        root, reach = reached(found)
        packages.update({p["id"]: p for p in found["packages"] if p["id"] in reach})
        for package, dependencies in reach.items():
            edges.setdefault(package, set()).update(dependencies)

    def reference(identity):
        package = packages[identity]
        return f"pkg:cargo/{package['name']}@{package['version']}"

    def component(identity):
        package = packages[identity]
        described = {
            "type": "application" if identity == root else "library",
            "bom-ref": reference(identity),
            "name": package["name"],
            "version": package["version"],
            "licenses": [{"expression": package["license"].replace("/", " OR ")}],
            "purl": reference(identity),
        }
        if checksum := checksums[package["name"], package["version"]]:
            described["hashes"] = [{"alg": "SHA-256", "content": checksum}]
        return described

    time = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), timezone.utc)
    order = sorted(packages, key=reference)
    components = [component(identity) for identity in order if identity != root]
    digest = hashlib.sha256(json.dumps(components).encode()).digest()
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.UUID(bytes=digest[:16], version=4)}",
        "version": 1,
        "metadata": {"timestamp": time.isoformat(), "component": component(root)},
        "components": components,
        "dependencies": [
            {"ref": reference(identity), "dependsOn": sorted(map(reference, edges[identity]))}
            for identity in order
        ],
    }
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
