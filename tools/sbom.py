"""What a release installs: a bill of materials in CycloneDX 1.6, made from the locks that every installation uses.

Packages of Python from `requirements.lock`, and those of npm that the console's page is made of.
"""

import re
import tomllib
import uuid
from datetime import datetime
from pathlib import Path
from typing import Final

from deploy.subset_lock import lock_entries, subset, wanted_roots
from tools.npm_lock import NpmPackage, console_packages, direct_packages

ROOT: Final = Path(__file__).resolve().parents[1]
# What is needed to develop and to measure is no part of the product.
_NOT_INSTALLED: Final = frozenset({"all", "bench", "dev"})
_VERSION: Final = re.compile(r"^[A-Za-z0-9._-]+==([^\s;\\]+)")
_HASH: Final = re.compile(r"--hash=sha256:([0-9a-f]{64})")
_NAMESPACE: Final = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")  # RFC 9562: names that are URLs
Json = dict[str, object]


def bill_of_materials(pyproject: str, lock: str, npm_lock: str, made_at: datetime) -> Json:
    """The bill of the version that `pyproject` states.

    Parameters
    ----------
    lock
        Text of `requirements.lock`.
    npm_lock
        Text of the console's `package-lock.json`.
    made_at
        Of the revision, so that a bill that is made again is the same.
    """
    project = tomllib.loads(pyproject)["project"]
    extras = project["optional-dependencies"].keys() - _NOT_INSTALLED
    roots = {root for extra in extras for root in wanted_roots(pyproject, extra)} - {project["name"]}
    entries = lock_entries(subset(lock, roots))
    references = {name: _purl(name, text) for name, text, _ in entries}
    packages = {package.name: package for package in console_packages(npm_lock)}
    itself = f"pkg:pypi/{project['name']}@{project['version']}"
    asks: dict[str, list[str]] = {name: [] for name in references}
    for name, _, via in entries:
        for asker in via & references.keys():
            asks[asker].append(references[name])
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(_NAMESPACE, itself + lock + npm_lock)}",
        "version": 1,
        "metadata": {
            "timestamp": made_at.isoformat(),
            "component": {
                "type": "application",
                "bom-ref": itself,
                "name": project["name"],
                "version": project["version"],
                "purl": itself,
                "licenses": [{"license": {"id": project["license"]}}],
            },
        },
        "components": [
            *(_component(name, text, references[name]) for name, text, _ in entries),
            *(_npm_component(package) for package in packages.values()),
        ],
        "dependencies": [
            {
                "ref": itself,
                "dependsOn": sorted(
                    [
                        *(references[name] for name in roots),
                        *(packages[name].purl for name in direct_packages(npm_lock)),
                    ]
                ),
            },
            *({"ref": references[name], "dependsOn": sorted(asks[name])} for name in references),
            *(
                {"ref": one.purl, "dependsOn": sorted(packages[name].purl for name in one.asks_for)}
                for one in packages.values()
            ),
        ],
    }


def _npm_component(package: NpmPackage) -> Json:
    """Types and the compiler are asked for by others, and are in no page."""
    return {
        "type": "library",
        "bom-ref": package.purl,
        "name": package.name,
        "version": package.version,
        "scope": "excluded" if package.types_only else "required",
        "purl": package.purl,
        "hashes": [{"alg": "SHA-512", "content": package.sha512}],
        "licenses": [{"license": {"id": package.licence}}],
    }


def _purl(name: str, text: str) -> str:
    match = _VERSION.match(text)
    assert match is not None
    return f"pkg:pypi/{name}@{match[1]}"


def _component(name: str, text: str, purl: str) -> Json:
    """The hashes are of its files for all platforms; an installation takes one of them."""
    hashes = [{"alg": "SHA-256", "content": sha256} for sha256 in _HASH.findall(text)]
    return {
        "type": "library",
        "bom-ref": purl,
        "name": name,
        "version": purl.rpartition("@")[2],
        "purl": purl,
        "externalReferences": [{"type": "distribution", "url": purl, "hashes": hashes}],
    }
