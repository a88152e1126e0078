"""Pruning: by rule, told by an event, the chain still verifiable, nothing else touched."""

from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import IntegrityError

from services.ui_api.core.chain import ChainBroken, ChainIntact
from services.ui_api.core.event_data import ImageCalibrated, ImageReceived, Step, StepRecorded
from services.ui_api.core.events import EventDraft, EventKind
from services.ui_api.core.retention import DAY_NS, RetentionRules
from services.ui_api.record.images import images_named, stored_paths
from services.ui_api.record.prune import (
    PruningPlan,
    delete_pruned_images,
    give_back_space,
    plan_pruning,
    prune,
)
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record
from shared.parts.files import sha256_of
from tests.unit.services.ui_api.record.filled import fill

_RULES = RetentionRules(closed_days=100, frames_days=10)
_CLOSED = EventDraft(StepRecorded(Step.ABANDONED, (), True, "Mrs Smith went home"), "case-1", "Dr A", "Mrs Smith")


class _Clock:
    def __init__(self) -> None:
        self.day = 1000

    def now_ns(self) -> int:
        return self.day * DAY_NS


def _image(
    record: CaseRecord, images: Path, name: str, case_id: str | None, number: int, *, in_run: bool = False
) -> str:
    content = name.encode()
    sha256 = sha256_of(content)
    file = stored_paths(images, sha256)[0]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    received_at_ns = record._clock_ns()
    received = ImageReceived(sha256, f"1.2.{number}", received_at_ns, 1, None, "store", number, in_run)
    record.append(EventDraft(received, case_id, "imaging"))
    return sha256


@pytest.fixture
def clock() -> _Clock:
    return _Clock()


@pytest.fixture
def record(engine: Engine, clock: _Clock, tmp_path: Path) -> CaseRecord:
    """An old closed case, and an open one with the same parts; images of both and of none."""
    record = CaseRecord(engine, clock.now_ns)
    images = tmp_path / "images"
    fill(record)
    shot = _image(record, images, "shot", "case-1", 1)
    with record.write() as unit:
        document = unit.put_document(b"calibration of the shot")
        unit.append(EventDraft(ImageCalibrated(shot, "accepted", (), document), "case-1", "imaging"))
        unit.append(_CLOSED)
        unit.remember("key", "a" * 64, Answer(201, "{}", {}))
    _image(record, images, "of no case", None, 2)
    clock.day += 50
    fill(record, "case-2")
    _image(record, images, "frame", "case-2", 3, in_run=True)
    _image(record, images, "second shot", "case-2", 4)
    return record


def _plan(record: CaseRecord, engine: Engine) -> PruningPlan:
    return plan_pruning(engine, record.ledger, _RULES, record._clock_ns())


def test_nothing_goes_before_its_time(record: CaseRecord, engine: Engine, clock: _Clock) -> None:
    plan = _plan(record, engine)
    assert plan.cases == ()
    assert plan.images is not None
    assert plan.images.images == (sha256_of(b"of no case"),)
    clock.day = 1000 + 100
    assert _plan(record, engine).cases == (), "to the day"


def test_a_case_goes_and_the_chain_still_holds(
    record: CaseRecord, engine: Engine, clock: _Clock, tmp_path: Path
) -> None:
    clock.day = 1101
    before = verify_record(engine)
    plan = _plan(record, engine)
    (case,) = plan.cases
    assert (case.pruned_case_id, case.event_ranges) == ("case-1", ((1, 5),))
    assert case.documents == (sha256_of(b"calibration of the shot"),), "the parts are case-2's too"
    assert case.images == (sha256_of(b"shot"),)
    prune(record, plan, "Dr B")
    files = delete_pruned_images(engine, tmp_path / "images")
    give_back_space(engine)
    after = verify_record(engine)
    assert isinstance(before, ChainIntact)
    assert isinstance(after, ChainIntact)
    assert after.entries == before.entries + 2
    assert (files.deleted, files.kept) == (2, ())
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT who, why, data_json FROM events WHERE case_id = 'case-1'")).all()
        assert {tuple(row) for row in rows} == {("", "", "")}
        assert images_named(connection) == (sha256_of(b"frame"), sha256_of(b"second shot"))


def test_a_gateway_starts_on_a_pruned_record(record: CaseRecord, engine: Engine, clock: _Clock) -> None:
    clock.day = 1101
    prune(record, _plan(record, engine), "Dr B")
    again = CaseRecord(engine, clock.now_ns)
    assert set(again.ledger.cases) == {"case-2"}
    assert again.ledger.images == record.ledger.images, "nobody asks imaging for these numbers again"
    assert [e.kind for e in again.events_after(0)][-2:] == [EventKind.CASE_PRUNED, EventKind.IMAGES_PRUNED]
    assert again.events_after(0, "case-1") == []
    assert again.remembered("key") is None
    assert _plan(again, engine) == PruningPlan((), None)
    fill(again, "case-3")


def test_an_open_case_keeps_all_its_frames(record: CaseRecord, engine: Engine, clock: _Clock) -> None:
    clock.day = 5000
    plan = _plan(record, engine)
    assert [case.pruned_case_id for case in plan.cases] == ["case-1"]
    assert plan.images is not None
    assert sha256_of(b"frame") not in plan.images.images
    record.append(replace(_CLOSED, case_id="case-2"))
    clock.day += 50
    plan = _plan(record, engine)
    assert plan.images is not None
    assert plan.images.images == (sha256_of(b"of no case"), sha256_of(b"frame")), "a single shot stays with its case"


def test_a_frame_that_was_measured_stays(record: CaseRecord, engine: Engine, clock: _Clock) -> None:
    measured = ImageCalibrated(sha256_of(b"frame"), "accepted", (), "f" * 64)
    record.append(EventDraft(measured, "case-2", "imaging"), replace(_CLOSED, case_id="case-2"))
    clock.day += 50
    plan = _plan(record, engine)
    assert plan.images is not None
    assert plan.images.images == (sha256_of(b"of no case"),)


def test_a_file_that_comes_back_goes_the_next_time(
    record: CaseRecord, engine: Engine, clock: _Clock, tmp_path: Path
) -> None:
    clock.day = 1101
    prune(record, _plan(record, engine), "Dr B")
    assert delete_pruned_images(engine, tmp_path / "images").deleted == 2
    assert delete_pruned_images(engine, tmp_path / "images").deleted == 0
    stored_paths(tmp_path / "images", sha256_of(b"shot"))[0].write_bytes(b"shot")
    assert delete_pruned_images(engine, tmp_path / "images").deleted == 1


def test_content_that_is_gone_without_a_word_breaks_the_chain(record: CaseRecord, engine: Engine) -> None:
    on = "" if engine.dialect.name == "sqlite" else " ON events"
    with engine.begin() as connection:
        connection.execute(text(f"DROP TRIGGER events_refuse_update{on}"))
        connection.execute(text("UPDATE events SET who = '', why = '', data_json = '' WHERE sequence = 2"))
    verdict = verify_record(engine)
    assert isinstance(verdict, ChainBroken)
    assert verdict.message == "event 2 is empty, and no later event tells that it was pruned"


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE events SET who = 'x' WHERE case_id = 'case-1'",
        "UPDATE events SET who = '', why = '', data_json = '' WHERE case_id = 'case-2'",
        "UPDATE events SET who = '', why = '', data_json = '', at_ns = 1 WHERE case_id = 'case-1'",
        "UPDATE prunings SET case_id = 'case-2'",
        "DELETE FROM prunings",
        "DELETE FROM documents",
    ],
)
def test_what_was_declared_opens_no_other_door(
    record: CaseRecord, engine: Engine, clock: _Clock, statement: str
) -> None:
    clock.day = 1101
    prune(record, _plan(record, engine), "Dr B")
    with pytest.raises(IntegrityError, match="are append-only"), engine.begin() as connection:
        connection.execute(text(statement))
