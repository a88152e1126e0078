"""What differs from one recording to the next is replaced: identifiers, hashes, times, ages, durations. Pure."""

import hashlib
import re
from datetime import UTC, datetime, timedelta
from typing import Final

Json = object
_HASH: Final = re.compile(r"\b[0-9a-f]{64}\b")
_IDENTIFIER: Final = re.compile(
    r"\b[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}\b|\b[0-9a-f]{32}\b|\b[0-9a-f]{16}\b|(?<=\bcase-)[0-9a-f]{10}\b"
)
_UID: Final = re.compile(r"\b(?:\d+\.){4,}\d+\b")
_BEGIN: Final = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)
# Times whose nanoseconds are clocks of a process, which begin anywhere.
_NS: Final = "_ns"
_SECRETS: Final = ("access_token", "refresh_token", "password", "new_password")
# Lists are cut: an example shows what an item looks like.
_MOST_ITEMS: Final = 3


class Normaliser:
    """Gives the same name to the same thing, in the order in which things are met."""

    def __init__(self) -> None:
        self._hashes: dict[str, str] = {}
        self._identifiers: dict[str, str] = {}
        self._uids: dict[str, str] = {}
        self._times: dict[int, int] = {}

    def value(self, value: Json, name: str = "") -> Json:
        """A JSON value, its members named."""
        if isinstance(value, dict):
            return {key: self.value(one, key) for key, one in value.items()}
        if isinstance(value, list):
            return [self.value(one, name) for one in _cut(value)]
        if isinstance(value, str):
            return f"<{name}>" if name in _SECRETS else self.text(value) if name != "at" else _moment(len(self._times))
        if isinstance(value, int) and not isinstance(value, bool):
            return self._time(value) if name.endswith(_NS) else value
        return _rounded(value, name) if isinstance(value, float) else value

    def text(self, text: str) -> str:
        """A text, also a path or a line of a stream."""
        text = _HASH.sub(lambda found: self._hash(found[0]), text)
        text = _IDENTIFIER.sub(lambda found: self._identifier(found[0]), text)
        return _UID.sub(lambda found: self._uid(found[0]), text)

    def _hash(self, found: str) -> str:
        return self._hashes.setdefault(found, hashlib.sha256(f"example {len(self._hashes)}".encode()).hexdigest())

    def _identifier(self, found: str) -> str:
        made = hashlib.sha256(f"identifier {len(self._identifiers)}".encode()).hexdigest()[
            : len(found.replace("-", ""))
        ]
        if "-" in found:
            made = "-".join((made[:8], made[8:12], made[12:16], made[16:20], made[20:32]))
        return self._identifiers.setdefault(found, made)

    def _uid(self, found: str) -> str:
        return self._uids.setdefault(found, f"1.2.826.0.1.3680043.10.1.{len(self._uids) + 1}")

    def _time(self, at_ns: int) -> int:
        """Times keep their order of appearance; a second passes between them."""
        after_s = self._times.setdefault(at_ns, len(self._times))
        return int((_BEGIN + timedelta(seconds=after_s)).timestamp()) * 10**9


def _moment(after_s: int) -> str:
    return (_BEGIN + timedelta(seconds=after_s)).isoformat().replace("+00:00", "Z")


def _cut(items: list[Json]) -> list[Json]:
    """Items that have members are cut to a few; numbers of a matrix are not."""
    return items[:_MOST_ITEMS] if items and isinstance(items[0], dict) else items


def _rounded(value: float, name: str) -> float:
    """Ages are what they happened to be; lengths are rounded, so that they can be read."""
    return 0.5 if name == "age_s" else round(value, 4)
