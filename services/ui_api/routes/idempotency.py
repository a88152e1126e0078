"""Idempotency-Key: the same request under the same key is done once, and answered the same way every time.

The answer is stored in the same transaction as what was done, so that even after a kill a repeat finds both or neither.
Refusals are remembered as well: a repeat that arrives late must not act because the state of things has changed in the
meantime. Failures of the gateway or the bus (5xx) are not remembered, because nothing is recorded of them; nor is that
access was lost (401), because who signs in anew may ask again. What was answered is forgotten after a day.
"""

import hashlib
import itertools
import json
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Final, TypeVar

from fastapi import Header, Request
from pydantic import BaseModel
from starlette.responses import Response

from services.ui_api.handlers.refusals import RefusalKind, Refused, invalid
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.problems import PROBLEM_JSON, Problem, headers_of, log_refusal, problem_of, sender_of
from services.ui_api.routes.transactions import require_still
from shared.errors import DistalockError, RecordUnavailable

T = TypeVar("T")

# Stored answers that are too old are looked for with the first of so many requests.
_FORGET_EVERY = 100
# Chosen: each keeps one of the application's forty threads for up to a minute; what is about the robot needs them too.
MOST_ASKING: Final = 16
MOST_REPEATS: Final = 4
_ASK_AGAIN_AFTER_S: Final = 1.0
_UNAUTHENTICATED: Final = 401
_NO_HEADERS: Final[Mapping[str, str]] = {}

IdempotencyKey = Annotated[
    str, Header(alias="Idempotency-Key", min_length=1, max_length=255, description="New for every new action.")
]


@dataclass(frozen=True, slots=True)
class Keyed:
    """A request under its key.

    Attributes
    ----------
    request_sha256
        Covers user, method, path, body and a quoted header.
    require_still
        Called in the transaction, before anything is done; raises `Refused` where access was lost.
    """

    key: str
    request_sha256: str
    path: str
    require_still: Callable[[], None] = field(compare=False)
    sender: str = "unknown"


def keyed(request: Request, key: str, body: BaseModel, quoted: str = "") -> Keyed:
    """What identifies a request; `quoted` is a header that belongs to what it says, such as If-Match."""
    # Of another user it is another request: nobody gets the answer that was somebody else's.
    content = [request.state.user.name, request.method, request.url.path, body.model_dump(mode="json"), quoted]
    fingerprint = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return Keyed(key, fingerprint, request.url.path, partial(require_still, request), sender_of(request))


def json_answer(status: int, body: BaseModel, **headers: str) -> Answer:
    """An answer with a JSON body; header names are given with underscores."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Answer(status, body.model_dump_json(by_alias=True), {"content-type": "application/json"} | named)


def problem_answer(document: Problem, headers: Mapping[str, str] = _NO_HEADERS) -> Answer:
    """A problem document as an answer to be remembered."""
    named = {"content-type": PROBLEM_JSON, **headers}
    return Answer(document.status, document.model_dump_json(exclude_none=True), named)


class Idempotency:
    """Does each request once per key; a second one with the same key waits for the first and gets its answer."""

    def __init__(self, record: CaseRecord) -> None:
        self._record = record
        self._firsts = itertools.count()
        self._guard = threading.Lock()
        self._waiting: Counter[str] = Counter()
        self._locks: dict[str, threading.Lock] = {}
        self._places = threading.BoundedSemaphore(MOST_ASKING)

    def once(self, request: Keyed, act: Callable[[UnitOfWork], Answer]) -> Response:
        """Do something that needs only the record."""
        return self._once(request, lambda: None, lambda unit, _: act(unit))

    def has_answered(self, request: Keyed) -> bool:
        """Whether this very request has an answer already."""
        known = self._record.remembered(request.key)
        return known is not None and known.request_sha256 == request.request_sha256

    def once_after(self, request: Keyed, ask: Callable[[], T], act: Callable[[UnitOfWork, T], Answer]) -> Response:
        """Ask another service first, outside the transaction, then record and answer within one; raises `Refused`."""

        def ask_in_a_place() -> T:
            with self._place():
                return ask()

        return self._once(request, ask_in_a_place, act)

    def _once(self, request: Keyed, ask: Callable[[], T], act: Callable[[UnitOfWork, T], Answer]) -> Response:
        with self._alone(request.key):
            known = self._record.remembered(request.key)
            if known is not None:
                if known.request_sha256 != request.request_sha256:
                    raise invalid(
                        "idempotency_key_reused",
                        f"the key {request.key!r} was used for another request; send a new key with a new action",
                    )
                return _response(known.answer)
            return _response(self._first_time(request, ask, act))

    def _first_time(self, request: Keyed, ask: Callable[[], T], act: Callable[[UnitOfWork, T], Answer]) -> Answer:
        try:
            asked = ask()
            with self._record.write() as unit:
                request.require_still()
                answer = act(unit, asked)
                unit.remember(request.key, request.request_sha256, answer)
        except DistalockError as error:
            refusal = problem_of(error, request.path)
            if refusal.status >= 500 or refusal.status == _UNAUTHENTICATED:
                raise
            log_refusal(refusal, request.sender)
            answer = problem_answer(refusal, headers_of(error))
            with self._record.write() as unit:
                unit.remember(request.key, request.request_sha256, answer)
        self._forget_now_and_then()
        return answer

    def _forget_now_and_then(self) -> None:
        """Behind what was asked for: a motion must not wait for it, and what was done stays answered."""
        if next(self._firsts) % _FORGET_EVERY == 0:
            with suppress(RecordUnavailable):
                self._record.forget_old_answers()

    @contextmanager
    def _place(self) -> Iterator[None]:
        """One of the places for who waits for another service; raises `Refused`."""
        if not self._places.acquire(blocking=False):
            raise _busy(
                f"{MOST_ASKING} requests wait for registration or imaging (limit {MOST_ASKING}); try again when one "
                "has ended, or do not wait for it (POST .../operations)"
            )
        try:
            yield
        finally:
            self._places.release()

    @contextmanager
    def _alone(self, key: str) -> Iterator[None]:
        """Nobody else handles the same key meanwhile; raises `Refused` where too many wait for that."""
        with self._guard:
            if self._waiting[key] > MOST_REPEATS:
                raise _busy(
                    f"{MOST_REPEATS} repeats of this request wait for its answer (limit {MOST_REPEATS}); send it again "
                    "when the first is answered"
                )
            self._waiting[key] += 1
            lock = self._locks.setdefault(key, threading.Lock())
        try:
            with lock:
                yield
        finally:
            with self._guard:
                self._waiting[key] -= 1
                if self._waiting[key] == 0:
                    del self._waiting[key], self._locks[key]


def _busy(message: str) -> Refused:
    return Refused(RefusalKind.UNAVAILABLE, "gateway_busy", message, _ASK_AGAIN_AFTER_S)


def _response(answer: Answer) -> Response:
    return Response(answer.body_json, answer.status, dict(answer.headers))
