"""`distalock parts`: a part's hash, and which part files an installation may use besides those of the catalogue."""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from distalock.arguments import EXIT_BAD_INPUT
from shared.errors import ConfigurationError, InputError, PartFileInvalid
from shared.geometry.parts import GuidePart, RingPart
from shared.parts.approvals import Approval, PartApprovals, approval_of
from shared.parts.canonical import catalogue_sha256, part_sha256
from shared.parts.catalogue import catalogue
from shared.parts.files import guide_from_json, nail_from_json, read_part_file, ring_from_json
from shared.parts.guide_calibration_file import guide_calibration_from_json
from shared.parts.hexapod_file import hexapod_from_json
from shared.parts.lengths import MeasuredLength, check_length_of_guide, check_length_of_ring

_READERS: Final[Mapping[str, Callable[[bytes], object]]] = {
    "distalock/ring/1": ring_from_json,
    "distalock/guide/1": guide_from_json,
    "distalock/nail/1": nail_from_json,
    "distalock/hexapod/1": hexapod_from_json,
    "distalock/guide-calibration/1": guide_calibration_from_json,
}


def run(given: argparse.Namespace) -> int:
    """Run the action; 0 when it is done."""
    try:
        if given.action == "hash":
            return _hash(given.files)
        approvals = PartApprovals(given.state)
        if given.action == "list":
            return _list(approvals)
        length = _length(given.length)
        for approval in [checked_approval(file, given.by, length) for file in given.files]:
            _approve(approvals, approval)
    except (ConfigurationError, InputError) as error:
        print(f"distalock parts: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


def checked_approval(file: Path, who: str, length: MeasuredLength | None) -> Approval:
    """The approval of a file that can be read, and of a ring or guide that has the size of its file.

    Raises
    ------
    PartFileInvalid
        When it is no part file, no or another length was measured than it has, or who approves it has no name.
    """
    try:
        content = read_part_file(file)
        part = json.loads(content)
    except ValueError:
        raise PartFileInvalid(f"{file}: not JSON; name a part file") from None
    schema = str(part.get("schema")) if isinstance(part, dict) else ""
    if schema not in _READERS:
        raise PartFileInvalid(f"{file}: its schema is {schema!r}, expected one of {', '.join(_READERS)}")
    _check_length(file, _READERS[schema](content), length)
    try:
        return approval_of(part, part_sha256(content, str(file)), file.name, who, datetime.now(UTC), length)
    except ValidationError as error:
        raise PartFileInvalid(f"{file}: {error.errors()[0]['msg']}; give --by the name of who approves it") from None


def _check_length(file: Path, part: object, length: MeasuredLength | None) -> None:
    if not isinstance(part, GuidePart | RingPart):
        if length is not None:
            raise PartFileInvalid(f"{file}: a length is measured of rings and guides; leave out --length")
        return
    if length is None:
        raise PartFileInvalid(
            f"{file}: no single image shows whether a ring or guide has the size of its file; measure the built part, "
            "and add --length BALL BALL MM, the distance between the centres of two balls"
        )
    if isinstance(part, GuidePart):
        check_length_of_guide(part.balls, length)
    else:
        check_length_of_ring(part.balls, length)


def _length(words: list[str] | None) -> MeasuredLength | None:
    if words is None:
        return None
    try:
        return MeasuredLength(first=words[0], second=words[1], measured_mm=float(words[2]))
    except ValueError:
        raise InputError(f"--length: {words[2]!r} is no length in mm (above 0, below 1000)") from None


def _approve(approvals: PartApprovals, approval: Approval) -> None:
    known = approvals.holds(approval.sha256)
    if not known:
        approvals.add(approval)
    print(f"{approval.sha256}  {approval.file_name}  {'was approved before' if known else 'approved'}")


def _hash(files: Sequence[Path]) -> int:
    for file in files:
        print(f"{part_sha256(read_part_file(file), str(file))}  {file.name}")
    return 0


def _list(approvals: PartApprovals) -> int:
    for entry in catalogue():
        print(f"{catalogue_sha256(entry)}  {entry.name}  comes with the package")
    for one in approvals.all():
        measured = "" if one.length is None else f", {one.length.label}"
        print(
            f"{one.sha256}  {one.file_name}  {one.schema_name}, {one.approved_at:%Y-%m-%d %H:%M} by {one.approved_by}"
            f"{measured}"
        )
    return 0
