"""What of npm is in the console's page: the packages of `package-lock.json` that are not for development."""

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CONSOLE: Final = Path(__file__).resolve().parents[1] / "services" / "ui_api" / "console"
_FOLDER: Final = "node_modules/"
_SHA512: Final = "sha512-"


@dataclass(frozen=True, slots=True)
class NpmPackage:
    """One package of the lock.

    Attributes
    ----------
    sha512
        Of its archive, in hexadecimal.
    asks_for
        Names of what it asks for, as far as the lock has it outside development.
    types_only
        Whether it holds type declarations or the compiler alone, which others ask for and no page holds.
    """

    name: str
    version: str
    licence: str
    sha512: str
    asks_for: tuple[str, ...]
    types_only: bool

    @property
    def purl(self) -> str:
        """Package URL; the at sign of a scope is encoded."""
        return f"pkg:npm/{self.name.replace('@', '%40', 1)}@{self.version}"


def console_packages(lock: str) -> tuple[NpmPackage, ...]:
    """What the page is made of, directly or not, by name.

    Parameters
    ----------
    lock
        Text of a `package-lock.json` of version 3.
    """
    entries = {
        path.rpartition(_FOLDER)[2]: entry
        for path, entry in json.loads(lock)["packages"].items()
        if path and not entry.get("dev")
    }
    return tuple(_package(name, entries[name], frozenset(entries)) for name in sorted(entries))


def direct_packages(lock: str) -> frozenset[str]:
    """What the console asks for by itself."""
    return frozenset(json.loads(lock)["packages"][""]["dependencies"])


def console_lock() -> str:
    """Text of the console's lock."""
    return (CONSOLE / "package-lock.json").read_text(encoding="utf-8")


def _package(name: str, entry: dict[str, object], known: frozenset[str]) -> NpmPackage:
    asked = {str(one) for kind in ("dependencies", "peerDependencies") for one in _mapping(entry.get(kind))}
    integrity = str(entry["integrity"])
    if not integrity.startswith(_SHA512):
        raise ValueError(
            f"{name}: the lock states {integrity.partition('-')[0]}, sha512 is needed; run npm install again"
        )
    return NpmPackage(
        name=name,
        version=str(entry["version"]),
        licence=str(entry.get("license", "")),
        sha512=base64.b64decode(integrity.removeprefix(_SHA512)).hex(),
        asks_for=tuple(sorted(asked & known)),
        types_only=name.startswith("@types/") or name == "typescript",
    )


def _mapping(value: object) -> dict[str, object]:
    return value if isinstance(value, dict) else {}
