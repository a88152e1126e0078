"""What belongs to one case: its events, the documents that they name, its images."""

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np
import pydicom
from sqlalchemy import Engine, select

from services.ui_api.core.chain import ChainBroken, ChainEntry
from services.ui_api.core.events import EventKind
from services.ui_api.core.picture import grey_8_bits, png_of
from services.ui_api.record.images import stored_image
from services.ui_api.record.tables import DOCUMENTS
from services.ui_api.record.verify import documents_named, entries, verify_record
from shared.errors import InputError
from shared.parts.files import sha256_of

Json = dict[str, object]
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Document:
    """A document: a part file, a calibration, a localisation, a plan, an overlay; `sha256` names it in the events."""

    sha256: str
    media_type: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Image:
    """An image of the case; without its file when that is not there, and `note` then says why."""

    sha256: str
    dicom: bytes | None
    note: str = ""


@dataclass(frozen=True, slots=True)
class CaseContent:
    """A case as it is handed over.

    Attributes
    ----------
    events
        As JSON objects, in the order of the log.
    chain
        Number and hashes of every event of the record, also of other cases; None when they are not handed over.
    """

    case_id: str
    events: tuple[Json, ...]
    documents: tuple[Document, ...]
    images: tuple[Image, ...]
    chain: tuple[Json, ...] | None


def read_case(engine: Engine, image_dir: Path, case_id: str) -> CaseContent:
    """Everything of one case, from a record whose chain holds.

    Raises
    ------
    InputError
        When there is no such case, it was pruned, or the chain is broken.
    """
    verdict = verify_record(engine)
    if isinstance(verdict, ChainBroken):
        raise InputError(f"the record does not hold: {verdict.message}; restore it from a backup before anything else")
    with engine.connect() as connection:
        log = list(entries(connection))
        own = [entry for entry in log if entry.case_id == case_id]
        _require_case(own, case_id, log)
        named = sorted(frozenset[str]().union(*(documents_named(entry.data_json) for entry in own)))
        rows = connection.execute(select(DOCUMENTS).where(DOCUMENTS.c.sha256.in_(named)).order_by(DOCUMENTS.c.sha256))
        documents = tuple(Document(row.sha256, row.media_type, bytes(row.content)) for row in rows)
    events = tuple(_event(entry) for entry in own)
    images = tuple(_image(image_dir, sha256) for sha256 in _received(events))
    return CaseContent(case_id, events, documents, images, tuple(_link(entry) for entry in log))


def png_of_dicom(content: bytes) -> bytes | None:
    """A DICOM image as a PNG for people; None when its pixels cannot be decoded here."""
    try:
        dataset = pydicom.dcmread(io.BytesIO(content))
        pixels = np.asarray(dataset.pixel_array, dtype=np.float32)
    except Exception:  # noqa: BLE001 - decoders raise whatever they like; the DICOM file is there all the same
        return None
    frame = pixels if pixels.ndim == 2 else pixels[0]
    reversed_grey = dataset.get("PhotometricInterpretation") == "MONOCHROME1"
    return None if frame.ndim != 2 else png_of(grey_8_bits(frame.max() - frame if reversed_grey else frame))


def time_of(at_ns: int) -> str:
    """A time since 1970 for people, ISO 8601 in UTC."""
    return (_EPOCH + timedelta(microseconds=at_ns // 1000)).isoformat(timespec="milliseconds")


def _require_case(own: list[ChainEntry], case_id: str, log: list[ChainEntry]) -> None:
    if not own:
        cases = dict.fromkeys(e.case_id for e in log if e.case_id is not None and not e.is_pruned)
        raise InputError(f"there is no case {case_id!r}; the record has {', '.join(cases) or 'none'}")
    if any(entry.is_pruned for entry in own):
        raise InputError(f"case {case_id} was pruned: nothing is left of it but hashes; use an export made before")


def _event(entry: ChainEntry) -> Json:
    return {
        "sequence": entry.sequence,
        "at": time_of(entry.at_ns),
        "at_ns": entry.at_ns,
        "case_id": entry.case_id,
        "kind": entry.kind,
        "who": entry.who,
        "why": entry.why,
        "data": json.loads(entry.data_json),
        "previous_sha256": entry.previous_sha256,
        "sha256": entry.sha256,
    }


def _link(entry: ChainEntry) -> Json:
    return {"sequence": entry.sequence, "previous_sha256": entry.previous_sha256, "sha256": entry.sha256}


def _received(events: tuple[Mapping[str, object], ...]) -> Iterator[str]:
    """Hashes of the images of a case, each once, in the order of receipt."""
    seen: set[str] = set()
    for event in events:
        data = event["data"]
        if event["kind"] == EventKind.IMAGE_RECEIVED and isinstance(data, dict):
            sha256 = str(data["image_sha256"])
            if sha256 not in seen:
                seen.add(sha256)
                yield sha256


def _image(image_dir: Path, sha256: str) -> Image:
    file = stored_image(image_dir, sha256)
    if file is None:
        return Image(sha256, None, "its file is not in the image store (deleted by rule, or lost)")
    content = file.read_bytes()
    if sha256_of(content) != sha256:
        return Image(sha256, None, "its file in the image store is damaged: its content does not give its hash")
    return Image(sha256, content)
