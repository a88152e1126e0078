"""What takes seconds and moves nothing, computed while nobody waits for it: recorded, followed, and cancelled.

A service that computes is not interrupted: who cancels waits for it no more, and what it answers is dropped. Whether a
computation was cancelled or has ended is decided in one transaction, so that what was cancelled leaves nothing behind.
"""

import secrets
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, TypeVar

from services.ui_api.core.computation_event_data import (
    ComputationEnded,
    ComputationProgressed,
    ComputationRequested,
    ComputationStatus,
    ComputationVerb,
)
from services.ui_api.core.computations import Computation
from services.ui_api.core.events import EventDraft
from services.ui_api.handlers.refusals import conflict
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.errors import DistalockError, RecordUnavailable
from shared.threads import described, supervised
from shared.tracing import carried

T = TypeVar("T")

# Chosen: registration and imaging each do one thing at a time; the others wait.
_AT_ONCE: Final = 2
MOST_UNDER_WAY: Final = 8


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a computation: the path of what was made, or why nothing was.

    Attributes
    ----------
    code, message
        Empty when something was made.
    """

    result: str | None
    code: str = ""
    message: str = ""


Explained = Callable[[DistalockError], tuple[str, str]]


class ComputationHandler:
    """Computes, beside everything else.

    Parameters
    ----------
    record
        Where it is kept.
    """

    def __init__(self, record: CaseRecord) -> None:
        self._record = record
        self._workers = ThreadPoolExecutor(max_workers=_AT_ONCE, thread_name_prefix="computations")

    def close(self) -> None:
        """Begin nothing any more; what a service still computes is not waited for."""
        self._workers.shutdown(wait=False, cancel_futures=True)

    def adopt_orphans(self) -> None:
        """After a restart: nobody computes what an earlier run has begun."""
        message = "the gateway restarted before it had ended; begin it again"
        for computation in self._record.ledger.pending_computations():
            self._end(computation.requested.operation_id, ComputationStatus.FAILED, "gateway_restarted", message)

    def begin(
        self,
        unit: UnitOfWork,
        requested: "RequestedComputation",
        ask: Callable[[], T],
        keep: Callable[[UnitOfWork, T], Outcome],
        explained: Explained,
    ) -> Computation:
        """Record a computation, to begin when the transaction is on the disk.

        Parameters
        ----------
        ask
            Has a service compute; raises `DistalockError`.
        keep
            Records its answer.
        explained
            Code and sentence of what `ask` raised.

        Raises
        ------
        Refused
            When too many are under way.
        """
        under_way = len(self._record.ledger.pending_computations())
        if under_way >= MOST_UNDER_WAY:
            raise conflict(
                "too_many_computations",
                f"{under_way} computations are under way (limit {MOST_UNDER_WAY}); wait for one, or cancel one",
            )
        operation_id = secrets.token_hex(16)
        data = ComputationRequested(operation_id, requested.verb, requested.says)
        event = unit.append(EventDraft(data, requested.case_id, requested.who))

        def work() -> None:
            self._work(operation_id, requested.done_by, ask, keep, explained)

        unit.after_commit(lambda: self._hand_over(work))
        return Computation(data, requested.case_id, event.at_ns)

    def cancel(self, unit: UnitOfWork, operation_id: str, who: str) -> None:
        """End a computation that is under way; raises `Refused` when it has ended."""
        computation = self._record.ledger.computations[operation_id]
        if computation.ended:
            raise conflict("operation_ended", f"operation {operation_id} has ended: it is '{computation.status}'")
        message = f"cancelled by {who}: nothing of it is kept"
        data = ComputationEnded(operation_id, ComputationStatus.CANCELLED, "cancelled", message)
        unit.append(EventDraft(data, computation.case_id, who))

    def _hand_over(self, work: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the gateway is leaving: the next run says that this one was not done
            self._workers.submit(carried(supervised("computations", work)))

    def _work(
        self,
        operation_id: str,
        done_by: str,
        ask: Callable[[], T],
        keep: Callable[[UnitOfWork, T], Outcome],
        explained: Explained,
    ) -> None:
        """Compute and record; whatever goes wrong, the operation does not stay as it was."""
        try:
            if not self._note_step(operation_id, done_by):
                return
            answer = ask()
            self._keep(operation_id, answer, keep)
        except DistalockError as error:
            with suppress(RecordUnavailable):  # then the next start finds it without an end
                self._end(operation_id, ComputationStatus.FAILED, *explained(error))
        except Exception as error:
            with suppress(RecordUnavailable):
                message = f"the gateway failed while it was computed: {described(error)}"
                self._end(operation_id, ComputationStatus.FAILED, "internal_error", message)
            raise

    def _note_step(self, operation_id: str, done_by: str) -> bool:
        """Whether it is still wanted."""
        with self._record.write() as unit:
            computation = self._record.ledger.computations[operation_id]
            if computation.ended:
                return False
            unit.append(EventDraft(ComputationProgressed(operation_id, 2, done_by), computation.case_id, "gateway"))
        return True

    def _keep(self, operation_id: str, answer: T, keep: Callable[[UnitOfWork, T], Outcome]) -> None:
        with self._record.write() as unit:
            computation = self._record.ledger.computations[operation_id]
            if computation.ended:  # cancelled meanwhile
                return
            outcome = keep(unit, answer)
            status = ComputationStatus.FAILED if outcome.result is None else ComputationStatus.SUCCEEDED
            data = ComputationEnded(operation_id, status, outcome.code, outcome.message, outcome.result)
            unit.append(EventDraft(data, computation.case_id, "gateway"))

    def _end(self, operation_id: str, status: ComputationStatus, code: str, message: str) -> None:
        with self._record.write() as unit:
            computation = self._record.ledger.computations[operation_id]
            if not computation.ended:
                data = ComputationEnded(operation_id, status, code, message)
                unit.append(EventDraft(data, computation.case_id, "gateway"))


@dataclass(frozen=True, slots=True)
class RequestedComputation:
    """What a client asks for.

    Attributes
    ----------
    says
        What is computed, in words.
    done_by
        Who computes it, as a clause: "registration compares ...".
    """

    verb: ComputationVerb
    case_id: str
    who: str
    says: str
    done_by: str
