"""What the wheel needs, as a CycloneDX 1.6 list of components, and whether that fits together.

``python .ci/sbom.py FILE.cdx.json``: drawn from what is installed beside steelyard, without the
network; ends with 1 where a dependency is missing or of another version than its dependents ask for.
"""

import hashlib
import json
import os
import re
import sys
import uuid
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = "steelyard"


def key(name):
    """A name as package indices normalise it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(found: Distribution, extras):
    """Requirements that hold here."""
    for text in found.requires or ():
        asked = Requirement(text)
        marker = asked.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield asked


def collected():
    """Distributions by name, what each needs, and what does not fit."""
    there, edges, problems = {}, {}, []
    waiting = [(ROOT, frozenset({"all"}))]
    while waiting:
        name, extras = waiting.pop()
        if name in there and extras <= edges[name][1]:
            continue
        try:
            there[name] = distribution(name)
        except PackageNotFoundError:
            problems.append(f"{name}: is not installed")
            continue
        asked = list(needed(there[name], extras))
        edges[name] = ({key(each.name) for each in asked}, extras)
        for each in asked:
            waiting.append((key(each.name), frozenset(each.extras)))
            try:
                version = distribution(each.name).version
            except PackageNotFoundError:
                continue
            if not each.specifier.contains(version, prereleases=True):
                problems.append(f"{name}: asks for {each}, found {version}")
    return there, {name: edge for name, (edge, _) in edges.items()}, problems


def component(name, found):
    """A distribution as an entry of the list."""
    version, about = found.version, found.metadata
    licence = about.get("License-Expression") or about.get("License") or ""
    record = found.read_text("RECORD") or ""
    entry = {
        "type": "library",
        "bom-ref": f"pkg:pypi/{name}@{version}",
        "name": name,
        "version": version,
        "purl": f"pkg:pypi/{name}@{version}",
        # Of the list of its files with their hashes.
        "properties": [
            {
                "name": "steelyard:sha256-of-RECORD",
                "value": hashlib.sha256(record.encode()).hexdigest(),
            }
        ],
    }
    if licence and len(licence) < 100:
        entry["licenses"] = [{"license": {"name": licence.splitlines()[0]}}]
    return entry


def main():
    """Write the list; end with 1 where something does not fit."""
    there, edges, problems = collected()
    parts = [component(name, there[name]) for name in sorted(there)]
    refs = {each["name"]: each["bom-ref"] for each in parts}
    content = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {**component(ROOT, there[ROOT]), "type": "application"}},
        "components": [each for each in parts if each["name"] != ROOT],
        "dependencies": [
            {
                "ref": refs[name],
                "dependsOn": sorted(refs[each] for each in edges[name] if each in refs),
            }
            for name in sorted(there)
        ],
    }
    text = json.dumps(content, sort_keys=True)
    content["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, text)}"
    Path(sys.argv[1]).write_text(json.dumps(content, indent=1) + os.linesep, encoding="utf-8")
    print(f"{sys.argv[1]}: {len(parts)} components")
    for each in problems:
        print(f"sbom: {each}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
