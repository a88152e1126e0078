"""Remove from a record what a rule allows, so that its chain can still be verified."""

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Connection, Engine, select, text

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import (
    CasePruned,
    ImageNumbers,
    ImageReceived,
    ImageSkipped,
    ImagesPruned,
)
from services.ui_api.core.events import EventDraft
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.retention import ImageUses, Naming, RetentionRules, as_ranges, prunable_cases
from services.ui_api.record.codec import decoded
from services.ui_api.record.engines import is_sqlite
from services.ui_api.record.images import INDEX_FILE, images_named, stored_image
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.tables import DOCUMENTS
from services.ui_api.record.verify import entries
from shared.errors import InputError


@dataclass(frozen=True, slots=True)
class PruningPlan:
    """What the rules allow to be removed: whole cases, and files of images."""

    cases: tuple[CasePruned, ...]
    images: ImagesPruned | None


@dataclass(frozen=True, slots=True)
class DeletedFiles:
    """How many image files were deleted, and those that could not be."""

    deleted: int
    kept: tuple[Path, ...]


def plan_pruning(engine: Engine, ledger: Ledger, rules: RetentionRules, now_ns: int) -> PruningPlan:
    """What may be removed now. Nothing is changed."""
    going = prunable_cases(ledger.cases.values(), now_ns, rules)
    with engine.connect() as connection:
        naming, numbers = _naming(connection)
        stored = frozenset(connection.execute(select(DOCUMENTS.c.sha256)).scalars())
        cases: list[CasePruned] = []
        for case in going:
            only = naming.only_named_by(case.case_id)
            naming.forget(case.case_id)
            cases.append(_case_pruned(case, rules, numbers[case.case_id], only, stored))
        files = _prunable_files(connection, ledger, rules, now_ns)
    gone = {image for case in cases for image in case.images}
    files = tuple(sha256 for sha256 in files if sha256 not in gone)
    return PruningPlan(tuple(cases), ImagesPruned(rules.frames_sentence(), files) if files else None)


def prune(record: CaseRecord, plan: PruningPlan, who: str) -> None:
    """Carry out a plan, one case at a time: each with the event that records it, or not at all."""
    for case in plan.cases:
        with record.write() as unit:
            announcement = unit.append(EventDraft(case, None, who, case.rule))
            unit.erase_case(case.pruned_case_id, announcement, case.documents)
    if plan.images is not None:
        record.append(EventDraft(plan.images, None, who, plan.images.rule))


def delete_pruned_images(engine: Engine, image_dir: Path) -> DeletedFiles:
    """Delete files of images that were pruned, now or before, and that no event names as received since."""
    with engine.connect() as connection:
        gone = _pruned_images(connection) - set(images_named(connection))
    deleted, kept = list[str](), list[Path]()
    for sha256 in sorted(gone):
        file = stored_image(image_dir, sha256)
        if file is None:
            continue
        try:
            file.unlink()
        except OSError:
            kept.append(file)
        else:
            deleted.append(sha256)
    _forget_calibrations(image_dir / INDEX_FILE, deleted)
    return DeletedFiles(len(deleted), tuple(kept))


def give_back_space(engine: Engine) -> None:
    """Rewrite the database without what was erased, so that it lies in no free page either."""
    if is_sqlite(engine):
        engine.dispose()
        with closing(sqlite3.connect(str(engine.url.database), isolation_level=None)) as connection:
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as server:
        for table in ("events", "documents", "answers"):
            server.execute(text(f"VACUUM FULL {table}"))


def _case_pruned(
    case: Case, rules: RetentionRules, numbers: list[int], only: frozenset[str], stored: frozenset[str]
) -> CasePruned:
    images = dict.fromkeys(image.image_sha256 for image in case.images)
    by_store: dict[str, list[int]] = {}
    for image in case.images:
        if image.store_id is not None and image.sequence is not None:
            by_store.setdefault(image.store_id, []).append(image.sequence)
    return CasePruned(
        pruned_case_id=case.case_id,
        rule=rules.closed_sentence(),
        event_ranges=as_ranges(numbers),
        documents=tuple(sorted(only & stored)),
        images=tuple(sha256 for sha256 in images if sha256 in only),
        image_numbers=tuple(ImageNumbers(store, as_ranges(of_store)) for store, of_store in by_store.items()),
    )


def _naming(connection: Connection) -> tuple[Naming, dict[str, list[int]]]:
    """Who names what, and the numbers of each case's events."""
    naming, numbers = Naming(), dict[str, list[int]]()
    for entry in entries(connection):
        naming.see(entry.case_id, entry.data_json)
        if entry.case_id is not None:
            numbers.setdefault(entry.case_id, []).append(entry.sequence)
    return naming, numbers


def _prunable_files(connection: Connection, ledger: Ledger, rules: RetentionRules, now_ns: int) -> tuple[str, ...]:
    opened = ledger.open_case()
    uses = ImageUses(None if opened is None else opened.case_id)
    for entry in entries(connection):
        data = None if entry.is_pruned else decoded(entry).data
        if isinstance(data, ImageReceived):
            uses.receive(entry.case_id, data)
        elif not isinstance(data, ImageSkipped | ImagesPruned):
            uses.measure(entry.data_json)
    there = set(images_named(connection))
    return tuple(sha256 for sha256 in uses.prunable(now_ns, rules) if sha256 in there)


def _pruned_images(connection: Connection) -> set[str]:
    pruned: set[str] = set()
    for entry in entries(connection):
        data = None if entry.is_pruned else decoded(entry).data
        if isinstance(data, CasePruned | ImagesPruned):
            pruned.update(data.images)
    return pruned


def _forget_calibrations(index: Path, images: Iterable[str]) -> None:
    """Imaging keeps what came of an image beside its number; the number stays, for numbers have no gap."""
    if not index.is_file():
        return
    try:
        with closing(sqlite3.connect(index, isolation_level=None)) as connection:
            for sha256 in images:
                connection.execute("UPDATE images SET calibration = NULL WHERE sha256 = ?", (sha256,))
    except sqlite3.Error as error:
        raise InputError(
            f"the files of images are deleted; their calibrations stay in the index {index}, which cannot be written: "
            f"{error}; end imaging, or see to the file"
        ) from None
