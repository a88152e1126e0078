"""Part files for a case: from the shipped catalogue by name, or inline; validated before anything is stored."""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from services.ui_api.core.event_data import PartUse
from services.ui_api.handlers.refusals import invalid
from shared.errors import PartFileInvalid
from shared.parts.canonical import canonical_part, part_sha256
from shared.parts.catalogue import PartKind, catalogue_entry, catalogue_names, schema_of
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json, sha256_of
from shared.parts.hexapod_file import hexapod_from_json

JsonObject = Mapping[str, object]
INLINE = "inline"
_log = logging.getLogger("distalock.ui_api")


@dataclass(frozen=True, slots=True)
class PartFile:
    """A valid part file: its canonical text, and how the case refers to it, by the hash of that text."""

    use: PartUse
    content: bytes


@dataclass(frozen=True, slots=True)
class _Stated:
    """What a case has to know of a part's content."""

    hole_ids: tuple[str, ...] = ()
    bone: str = ""


def _check_ring(content: bytes, source: str) -> _Stated:
    ring_from_json(content, source)
    return _Stated()


def _check_guide(content: bytes, source: str) -> _Stated:
    return _Stated(tuple(h.id for h in guide_from_json(content, source).holes))


def _check_nail(content: bytes, source: str) -> _Stated:
    nail = nail_from_json(content, source)
    return _Stated(tuple(h.id for h in nail.holes), nail.bone or "")


def _check_hexapod(content: bytes, source: str) -> _Stated:
    hexapod_from_json(content, source)
    return _Stated()


# Each check validates a file's content; raises `PartFileInvalid`.
_CHECKS: Mapping[PartKind, Callable[[bytes, str], _Stated]] = {
    "ring": _check_ring,
    "guide": _check_guide,
    "nail": _check_nail,
    "hexapod": _check_hexapod,
}


def resolve_part(kind: PartKind, given: str | JsonObject) -> PartFile:
    """A part by its name in the catalogue, or from the JSON object of a part file.

    Raises
    ------
    Refused
        When there is no part of that name.
    PartFileInvalid
        When the file breaks its schema, or is of another kind.
    """
    if isinstance(given, str):
        name, content = given, _from_catalogue(kind, given)
    else:
        name, content = INLINE, _inline(kind, given)
    _require_schema(kind, name, content)
    source = f"{kind} '{name}'"
    stated, text = _CHECKS[kind](content, source), canonical_part(content, source)
    return PartFile(PartUse(name, sha256_of(text), stated.hole_ids, stated.bone), text)


def require_approved(kind: str, given: str | JsonObject, is_approved: Callable[[str], bool]) -> None:
    """Refuse a file that no administrator has approved; a part of the catalogue comes with the package.

    Raises
    ------
    Refused
        With the file's hash and the remedy.
    PartFileInvalid
        When the file breaks its schema.
    """
    if isinstance(given, str):
        return
    sha256 = part_sha256(_inline(kind, given), f"{kind} '{INLINE}'")
    if not is_approved(sha256):
        _log.warning("part_not_approved: %s file with hash %s", kind, sha256)
        raise invalid(
            "part_not_approved",
            f"the {kind} file with hash {sha256} is not approved for this installation; have an administrator look at "
            "it and approve it once (distalock parts approve FILE --by NAME)",
        )


def _inline(kind: str, given: JsonObject) -> bytes:
    try:
        return json.dumps(given, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        half = error.object[error.start]
        raise PartFileInvalid(f"{kind} '{INLINE}': {half!a} is half a character (a lone surrogate), not text") from None


def _from_catalogue(kind: PartKind, name: str) -> bytes:
    entry = catalogue_entry(name)
    if entry is None:
        known = ", ".join(catalogue_names(kind)) or "none"
        raise invalid("unknown_part", f"the catalogue has no {kind} named {name!r}; it has {known}")
    return entry.content


def _require_schema(kind: PartKind, name: str, content: bytes) -> None:
    """Say plainly that a nail is not a ring, instead of listing every key that differs."""
    found = schema_of(content)
    if found != f"distalock/{kind}/1":
        raise PartFileInvalid(f"{kind} '{name}': its schema is {found!r}, expected 'distalock/{kind}/1'")
