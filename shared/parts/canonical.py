"""One text and one hash of a part, however its file is written: spaces, order of keys and `1` or `1.0` say nothing.

The canonical text is what a case keeps of a part and what `GET /parts/{name}` answers; its SHA-256 is the part's hash
in the case, in approvals, in calibrations, in plans and permits, and in the robot's state.
"""

from collections.abc import Mapping
from typing import Final

from shared.errors import PartFileInvalid
from shared.parts.catalogue import CatalogueEntry, schema_of
from shared.parts.files import GuideFile, NailFile, PartModel, RingFile, canonical_text, parse_part, sha256_of
from shared.parts.guide_calibration_file import GuideCalibrationFile
from shared.parts.hexapod_file import HexapodFile

_MODELS: Final[Mapping[object, type[PartModel]]] = {
    "distalock/ring/1": RingFile,
    "distalock/guide/1": GuideFile,
    "distalock/nail/1": NailFile,
    "distalock/hexapod/1": HexapodFile,
    "distalock/guide-calibration/1": GuideCalibrationFile,
}


def canonical_part(content: bytes, source: str) -> bytes:
    """The canonical text of a part file, or of a guide calibration; `PartFileInvalid` when it breaks its schema."""
    try:
        schema = schema_of(content)
    except ValueError:
        raise PartFileInvalid(f"{source}: not JSON; name a part file") from None
    model = _MODELS.get(schema) if isinstance(schema, str) else None
    if model is None:
        raise PartFileInvalid(f"{source}: its schema is {schema!r}, expected one of {', '.join(map(str, _MODELS))}")
    return canonical_text(parse_part(model, content, source))


def part_sha256(content: bytes, source: str) -> str:
    """A part's hash, from any of its files; raises as `canonical_part`."""
    return sha256_of(canonical_part(content, source))


def catalogue_sha256(entry: CatalogueEntry) -> str:
    """The hash of a part of the catalogue."""
    return part_sha256(entry.content, entry.name)
