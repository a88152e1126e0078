"""Records with something in them."""

import itertools
from dataclasses import replace

from sqlalchemy import Engine

from services.ui_api.core.event_data import CaseOpened, PartUse, Step, StepRecorded
from services.ui_api.core.events import EventDraft
from services.ui_api.record.record import CaseRecord
from tests.unit.services.ui_api import samples

STEP = EventDraft(StepRecorded(Step.DRILLED, ("distal",), True, "it was done"), "case-1", "Dr A", "it was done")


def record_of(engine: Engine) -> CaseRecord:
    """A record whose clock counts entries."""
    ticks = itertools.count(1_000)
    return CaseRecord(engine, lambda: next(ticks))


def fill(record: CaseRecord, case_id: str = "case-1") -> None:
    """A case with all the documents that its events name, and a step."""
    with record.write() as unit:
        ring, guide, nail, hexapod = (
            PartUse(name, unit.put_document(name.encode())) for name in ("ring", "guide", "nail", "hexapod")
        )
        setup = replace(samples.case_setup(), ring=ring, guide=guide, nail=nail, hexapod=hexapod)
        unit.append(EventDraft(CaseOpened(setup), case_id, "Dr A"))
        unit.append(replace(STEP, case_id=case_id))
