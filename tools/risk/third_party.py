"""`docs/risk/third-party.md`: software of others, with versions from the lock, and its known vulnerabilities."""

import json
import re
import tomllib
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter
from typing_extensions import TypedDict

from deploy.subset_lock import lock_entries, normalised, subset, wanted_roots
from tools.npm_lock import console_lock, console_packages
from tools.risk.evidence import ROOT
from tools.risk.files import FOLDER, ThirdParty, entries
from tools.risk.tables import NOT_A_DEVICE, table

AUDIT: Final = FOLDER / "audit.json"
# What is needed to develop and to measure is no part of the product.
_NOT_INSTALLED: Final = frozenset({"all", "bench", "dev", "kernels"})
_VERSION: Final = re.compile(r"==([^\s;\\]+)")
_HEAD: Final = f"""{NOT_A_DEVICE} This page is printed by `make generated` from `third-party.yaml` and
`requirements.lock`, which pins every file by its hash ([releases](../releases.md) has the same as
a bill of materials in CycloneDX). Software of unknown provenance after IEC 62304, 8.1.2: what the
product asks for by itself, what a defect of it could do here, and what would show that. Python
itself and the operating system are not listed."""


class Vulnerability(TypedDict):
    """What is known of one version of one package."""

    name: str
    version: str
    id: str
    fixed_in: list[str]


class Audit(TypedDict):
    """What `distalock risk audit` found, or why it could not look.

    Attributes
    ----------
    lock_sha256
        Of the lock that was looked up.
    skipped
        Packages that the database did not know; that is not the same as well.
    """

    at: str
    lock_sha256: str
    looked_up: int
    skipped: int
    why_not: str
    found: list[Vulnerability]


def third_party_page() -> str:
    """The page."""
    named = entries(FOLDER / "third-party.yaml", ThirdParty)
    locked = product_versions()
    direct = direct_names()
    rows = (
        (f"`{one.name}`", locked[one.name], ", ".join(one.items), one.does, one.wrong, one.shown)
        for one in sorted(named, key=lambda one: one.name)
    )
    others = ", ".join(f"`{name}` {version}" for name, version in sorted(locked.items()) if name not in direct)
    heads = ("package", "version", "items", "does", "a defect could", "shown by")
    npm = {package.name: package for package in console_packages(console_lock()) if not package.types_only}
    of_page = sorted(entries(FOLDER / "third-party-console.yaml", ThirdParty), key=lambda one: one.name)
    page_rows = (
        (f"`{one.name}`", npm[one.name].version, ", ".join(one.items), one.does, one.wrong, one.shown)
        for one in of_page
    )
    named_there = {one.name for one in of_page}
    npm_others = ", ".join(f"`{name}` {one.version}" for name, one in npm.items() if name not in named_there)
    return "\n".join(
        [
            "# Software of others",
            "",
            _HEAD,
            "",
            *table(heads, rows),
            "",
            f"What these ask for in turn: {others}.",
            "",
            "## In the console's page",
            "",
            "From npm, by the console's `package-lock.json`; what only builds or checks the page is not listed.",
            "",
            *table(heads, page_rows),
            "",
            f"What these ask for in turn: {npm_others}.",
            "",
            "## Known vulnerabilities",
            "",
            _known(read_audit()),
            "",
        ]
    )


def direct_names() -> set[str]:
    """Packages that the product asks for by itself."""
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(pyproject)["project"]
    extras = project["optional-dependencies"].keys() - _NOT_INSTALLED
    return {root for extra in extras for root in wanted_roots(pyproject, extra)} - {project["name"]}


def product_versions() -> dict[str, str]:
    """Version of each package that an installation of the product has."""
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    found = lock_entries(subset(lock, direct_names()))
    return {normalised(name): match[1] for name, text, _ in found if (match := _VERSION.search(text))}


def read_audit(file: Path = AUDIT) -> Audit | None:
    """The last audit; None when there was none."""
    if not file.exists():
        return None
    return TypeAdapter(Audit).validate_python(json.loads(file.read_text(encoding="utf-8")))


def _known(audit: Audit | None) -> str:
    how = "`distalock risk audit` asks the advisory database of PyPI by pip-audit, where it can be reached."
    if audit is None:
        return f"{how} It has not been run."
    if audit["why_not"]:
        why = f"On {audit['at']} it could not: {audit['why_not']}"
        return f"{how} {why}. So nothing is known here, which is not the same as none."
    about = f"{how} On {audit['at']} it looked up {audit['looked_up']} packages of the lock "
    about += f"{audit['lock_sha256'][:12]}, and could not {audit['skipped']}: "
    about += f"{len(audit['found'])} known vulnerabilities."
    rows = ((f"`{v['name']}`", v["version"], v["id"], ", ".join(v["fixed_in"]) or "-") for v in audit["found"])
    heads = ("package", "version", "advisory", "fixed in")
    return "\n".join([about, *(["", *table(heads, rows)] if audit["found"] else [])])
