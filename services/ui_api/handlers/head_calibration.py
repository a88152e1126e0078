"""A case's hexapod with its head as `distalock robot calibrate-guide` found it."""

import json
from dataclasses import replace

from services.ui_api.handlers.parts import JsonObject, PartFile, resolve_part
from services.ui_api.handlers.refusals import invalid
from shared.parts.guide_calibration_file import guide_calibration_from_json
from shared.parts.hexapod_file import hexapod_from_json, hexapod_json_with_head

_SCHEMA = "distalock/guide-calibration/1"


def is_head_calibration(given: JsonObject) -> bool:
    """Whether this is what `calibrate-guide` prints; otherwise it is a guide file."""
    return given.get("schema") == _SCHEMA


def calibrated_hexapod(hexapod: PartFile | None, given: JsonObject) -> PartFile:
    """The hexapod file with another head: what `calibrate-guide --out` writes.

    Raises
    ------
    Refused
        When the calibration was rejected, or made with another hexapod file.
    PartFileInvalid
        When it breaks its schema.
    """
    calibration = guide_calibration_from_json(json.dumps(given).encode())
    if calibration.verdict != "accepted":
        why = "; ".join(reason.message for reason in calibration.reasons)
        raise invalid("guide_calibration_rejected", f"the guide's calibration was rejected: {why}")
    made_with = calibration.hexapod_sha256
    if hexapod is None or hexapod_from_json(hexapod.content).sha256 != made_with:
        found = "none is given beside it" if hexapod is None else f"the case names '{hexapod.use.name}'"
        raise invalid(
            "guide_calibration_mismatch",
            f"the guide's calibration was made with hexapod file {made_with[:12]}, {found}; give the calibration "
            "together with the hexapod file that it was made with",
        )
    content = hexapod_json_with_head(hexapod.content, calibration.matrix(), calibration.head_extension_mm)
    with_head = resolve_part("hexapod", json.loads(content))
    return PartFile(replace(with_head.use, name=hexapod.use.name), with_head.content)
