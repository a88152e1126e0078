"""PostgreSQL killed, restarted, or gone in the middle of a commit: what was acknowledged is there, and work goes on."""

import signal
from collections.abc import Callable, Iterator
from functools import partial

import pytest
from sqlalchemy import Connection, event
from sqlalchemy.exc import OperationalError

from services.ui_api.core.chain import ChainIntact
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import Event, EventDraft
from services.ui_api.record.database import open_database
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import Answer
from services.ui_api.record.verify import verify_record
from shared.errors import RecordUnavailable
from tests.postgresql import Server

_EVENT = EventDraft(GatewayStarted("epoch", "version"), None, "writer")


@pytest.fixture
def record(postgresql: Server, migrated: str) -> Iterator[CaseRecord]:
    opened = CaseRecord(open_database(postgresql.url(postgresql.make_database(migrated))), lambda: 0)
    yield opened
    opened.close()


def _append_until_killed(record: CaseRecord, server: Server, point: int) -> None:
    """The server goes before the first statement, or after so many."""
    with record.write() as unit:
        steps: tuple[Callable[[], object], ...] = (
            partial(unit.append, _EVENT),
            partial(unit.put_document, b"[]"),
            partial(unit.remember, "key", "a" * 64, Answer(201, "{}", {})),
        )
        for number, step in enumerate(steps):
            if number == point:
                server.end(signal.SIGQUIT)
            step()
        if point == len(steps):
            server.end(signal.SIGQUIT)


def test_a_gateway_goes_on_when_the_server_is_back(postgresql: Server, record: CaseRecord) -> None:
    record.append(_EVENT)
    postgresql.end(signal.SIGQUIT)
    try:
        with pytest.raises(
            RecordUnavailable, match=r"the case record cannot be written now \(connection failed: [^\n]*"
        ):
            record.append(_EVENT)
    finally:
        postgresql.start()
    record.append(_EVENT)
    assert record.ledger.head_sequence == 2
    assert len(record.events_after(0)) == 2


@pytest.mark.parametrize("point", range(4))
def test_a_killed_server_keeps_every_acknowledged_event(postgresql: Server, record: CaseRecord, point: int) -> None:
    """At each point of a unit of work that writes an event, a document and an answer."""
    for _ in range(3):
        record.append(_EVENT)
    try:
        with pytest.raises(RecordUnavailable):
            _append_until_killed(record, postgresql, point)
    finally:
        postgresql.start()
    record.append(_EVENT)
    assert verify_record(record._engine) == ChainIntact(4, record._head_sha256)
    assert record.ledger.head_sequence == 4
    assert record.remembered("key") is None


def test_what_was_committed_without_a_word_is_taken_in(record: CaseRecord) -> None:
    """The connection goes after the server committed and before it said so."""
    told: list[Event] = []
    record.listen(told.extend)
    record.append(_EVENT)

    def commit_without_a_word(connection: Connection) -> None:
        connection.connection.driver_connection.commit()  # type: ignore[union-attr]
        raise OperationalError("COMMIT", None, Exception("server closed the connection unexpectedly"))

    event.listen(record._engine, "commit", commit_without_a_word)
    with pytest.raises(RecordUnavailable, match="server closed the connection"):
        record.append(_EVENT)
    event.remove(record._engine, "commit", commit_without_a_word)
    assert record.ledger.head_sequence == 1
    record.append(_EVENT)
    assert [e.sequence for e in told] == [1, 2, 3]
    assert record.ledger.head_sequence == 3
    assert isinstance(verify_record(record._engine), ChainIntact)
