"""One key, one effect: also when the same request comes twice at once."""

import itertools
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from services.ui_api.handlers.refusals import Refused, conflict, unauthenticated
from services.ui_api.record.database import open_database, sqlite_url
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.idempotency import Idempotency, Keyed
from shared.errors import NoReply
from tests.unit.services.ui_api.fakes import PATIENCE_S


def _keyed(key: str, letter: str, require_still: Callable[[], None] = lambda: None) -> Keyed:
    return Keyed(key, letter * 64, "/api/v1/cases", require_still)


_REQUEST = _keyed("key", "a")
_OTHER = _keyed("key", "b")


class Handler:
    """Counts what is asked of it; `ask` waits while `hold` is clear."""

    def __init__(self) -> None:
        self.asked = 0
        self.done = 0
        self.hold = threading.Event()
        self.hold.set()
        self.entered = threading.Event()

    def ask(self) -> int:
        self.asked += 1
        self.entered.set()
        self.hold.wait(PATIENCE_S)
        return self.asked

    def act(self, unit: UnitOfWork, asked: int) -> Answer:
        del unit
        self.done += 1
        return Answer(201, f'{{"asked":{asked}}}', {"content-type": "application/json", "etag": '"x"'})


@pytest.fixture
def idempotency(tmp_path: Path) -> Idempotency:
    ticks = itertools.count()
    return Idempotency(CaseRecord(open_database(sqlite_url(tmp_path)), lambda: next(ticks)))


def test_a_repeat_gets_the_same_answer_with_its_headers(idempotency: Idempotency) -> None:
    handler = Handler()
    first, second = (idempotency.once_after(_REQUEST, handler.ask, handler.act) for _ in range(2))
    assert (first.status_code, first.body, first.headers) == (second.status_code, second.body, second.headers)
    assert second.headers["etag"] == '"x"'
    assert (handler.asked, handler.done) == (1, 1)


def test_another_request_under_the_same_key_is_refused(idempotency: Idempotency) -> None:
    handler = Handler()
    idempotency.once_after(_REQUEST, handler.ask, handler.act)
    with pytest.raises(Refused, match="the key 'key' was used for another request"):
        idempotency.once_after(_OTHER, handler.ask, handler.act)
    assert handler.done == 1


def test_a_second_request_waits_for_the_first_and_gets_its_answer(idempotency: Idempotency) -> None:
    handler = Handler()
    handler.hold.clear()
    bodies: list[bytes] = []

    def request() -> None:
        bodies.append(bytes(idempotency.once_after(_REQUEST, handler.ask, handler.act).body))

    first, second = threading.Thread(target=request), threading.Thread(target=request)
    first.start()
    assert handler.entered.wait(PATIENCE_S)
    handler.entered.clear()
    second.start()
    assert not handler.entered.wait(0.2), "the second request was not held back"
    handler.hold.set()
    first.join(PATIENCE_S)
    second.join(PATIENCE_S)
    assert (handler.asked, bodies[0]) == (1, bodies[1])


def test_requests_under_other_keys_do_not_wait(idempotency: Idempotency) -> None:
    handler, other = Handler(), Handler()
    handler.hold.clear()
    slow = threading.Thread(target=idempotency.once_after, args=(_REQUEST, handler.ask, handler.act))
    slow.start()
    assert handler.entered.wait(PATIENCE_S)
    idempotency.once_after(_keyed("other", "a"), other.ask, other.act)
    assert other.done == 1
    handler.hold.set()
    slow.join(PATIENCE_S)


def test_a_refusal_is_remembered_and_a_failure_is_not(idempotency: Idempotency) -> None:
    def fails(error: Exception) -> Callable[[], int]:
        def ask() -> int:
            raise error

        return ask

    handler = Handler()
    with pytest.raises(NoReply, match="nobody answers"):
        idempotency.once_after(_REQUEST, fails(NoReply("nobody answers")), handler.act)
    refused = idempotency.once_after(_REQUEST, fails(conflict("not_now", "not now")), handler.act)
    assert refused.status_code == 409
    again = idempotency.once_after(_REQUEST, handler.ask, handler.act)
    assert (again.status_code, again.body, handler.done) == (409, refused.body, 0)


def test_lost_access_refuses_before_anything_is_done_and_is_not_remembered(idempotency: Idempotency) -> None:
    def lost() -> None:
        raise unauthenticated("token_invalid", "the session ended")

    handler = Handler()
    with pytest.raises(Refused, match="the session ended"):
        idempotency.once_after(_keyed("key", "a", lost), handler.ask, handler.act)
    assert (handler.asked, handler.done) == (1, 0)
    assert idempotency.once_after(_REQUEST, handler.ask, handler.act).status_code == 201
    repeated = idempotency.once_after(_keyed("key", "a", lost), handler.ask, handler.act)
    assert (repeated.status_code, handler.done) == (201, 1), "what was done is answered without doing anything"
