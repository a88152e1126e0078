"""The file of anchors: one JSON line each, only ever longer."""

import os
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import Engine, select

from services.ui_api.core.anchors import Anchor, check_anchors, next_anchor
from services.ui_api.core.chain import ChainBroken, ChainIntact
from services.ui_api.record.tables import EVENTS
from services.ui_api.record.verify import verify_record
from shared.errors import InputError
from shared.json_lines import json_lines

_ANCHOR = TypeAdapter(Anchor)


def read_anchors(file: Path) -> list[Anchor]:
    """All anchors; raises `InputError` when the file cannot be read or a line is none."""
    anchors: list[Anchor] = []
    try:
        lines = json_lines(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"anchors {file} cannot be read: {error}") from None
    for number, line in enumerate(lines, 1):
        try:
            anchors.append(_ANCHOR.validate_json(line))
        except ValidationError as error:
            raise InputError(f"line {number} of {file} is no anchor: {error.errors()[0]['msg']}") from None
    return anchors


def verify_with_anchors(
    engine: Engine, anchors: Sequence[Anchor], tsa: str, has_signed: Callable[[str, bytes], bool]
) -> ChainIntact | ChainBroken:
    """Check a whole record, and that it still has every head that was countersigned."""
    verdict = verify_record(engine)
    if isinstance(verdict, ChainBroken):
        return verdict
    with engine.connect() as connection:
        hashes = list(connection.execute(select(EVENTS.c.sha256).order_by(EVENTS.c.sequence)).scalars())
    return check_anchors(anchors, hashes, tsa, has_signed) or verdict


def append_anchor(
    file: Path, before: Sequence[Anchor], chain: ChainIntact, now: datetime, tsa: str, sign: Callable[[bytes], str]
) -> Anchor:
    """Countersign a head and write the anchor behind the others, on the disk."""
    anchor = next_anchor(before, chain, now.isoformat(timespec="seconds"), tsa, sign)
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("ab") as stream:
        stream.write(_ANCHOR.dump_json(anchor) + b"\n")
        stream.flush()
        os.fsync(stream.fileno())
    return anchor
