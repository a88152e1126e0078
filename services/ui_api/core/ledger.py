"""All cases and operations, folded from the whole event log: what the gateway knows, and its only source of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from services.ui_api.core import computations
from services.ui_api.core.case import Case, applied, opened_case
from services.ui_api.core.computation_event_data import (
    ComputationEnded,
    ComputationProgressed,
    ComputationRequested,
)
from services.ui_api.core.computations import Computation
from services.ui_api.core.event_data import CaseOpened, CasePruned, ImageReceived
from services.ui_api.core.events import Event, EventKind
from services.ui_api.core.guide_moved import UNSEEN, RobotWatch
from services.ui_api.core.image_numbers import NumbersOnRecord
from services.ui_api.core.inside import Inside
from services.ui_api.core.operations import Operation, ended, progressed
from services.ui_api.core.robot_event_data import OperationEnded, OperationProgressed, OperationRequested, RobotChanged

# What happens by itself, or decides nothing: whoever changes a case need not have seen it.
_DECIDES_NOTHING: Final = frozenset(
    {
        EventKind.IMAGE_RECEIVED,
        EventKind.IMAGE_CALIBRATED,
        EventKind.IMAGE_SKIPPED,
        EventKind.LOCALISATION_RECEIVED,
        EventKind.PLAN_REFUSED,
        EventKind.VERIFICATION_REFUSED,
        EventKind.QA_REPORTED,
        EventKind.OPERATION_PROGRESSED,
        EventKind.COMPUTATION_REQUESTED,
        EventKind.COMPUTATION_PROGRESSED,
        EventKind.COMPUTATION_ENDED,
        EventKind.STOP_REQUESTED,
        EventKind.ROBOT_CHANGED,
        EventKind.PRESENCE_CHANGED,
        EventKind.BUS_REFUSED,
    }
)


@dataclass(slots=True)
class Ledger:
    """The state that the log adds up to. Cases and operations keep the order in which they began.

    The maps are replaced as a whole by `take`, so that a reader on another thread sees them either before or after an
    event, never in between. Of a case's images the newest `images_held` are held, and of those before them all but the
    frames of fluoroscopy from which nothing was measured; None holds all.
    """

    images_held: int | None = None
    cases: dict[str, Case] = field(default_factory=dict)
    operations: dict[str, Operation] = field(default_factory=dict)
    head_sequence: int = 0
    images: dict[str, NumbersOnRecord] = field(default_factory=dict)  # by image store, of all cases and none
    computations: dict[str, Computation] = field(default_factory=dict)

    robot: RobotWatch = UNSEEN  # of the newest event of the robot, of whatever case

    _decided: dict[str, int] = field(default_factory=dict)  # by case, the last event by which something was decided
    # Asked for with each state of the robot, when thousands have ended.
    _pending: tuple[Operation, ...] = field(init=False)

    def __post_init__(self) -> None:
        self._pending = tuple(operation for operation in self.operations.values() if not operation.ended)

    def take(self, event: Event) -> None:
        """Fold in one more event, which must be the next of the log."""
        if event.sequence != self.head_sequence + 1:
            raise ValueError(f"expected event {self.head_sequence + 1}, got event {event.sequence}")
        self._take_case(event)
        self._take_operation(event)
        self._take_computation(event)
        self._take_image(event)
        self._take_decision(event)
        if isinstance(event.data, RobotChanged):
            self.robot = self.robot.after(event.data)
        self.head_sequence = event.sequence

    def pass_over(self, sequence: int) -> None:
        """Count the next event of the log, whose content was pruned."""
        if sequence != self.head_sequence + 1:
            raise ValueError(f"expected event {self.head_sequence + 1}, got event {sequence}")
        self.head_sequence = sequence

    def with_events(self, events: Sequence[Event]) -> "Ledger":
        """The ledger after more events; this one stays as it is. Raises what an event brings that does not fit."""
        after = Ledger(self.images_held)
        after.become(self)
        for event in events:
            after.take(event)
        return after

    def become(self, after: "Ledger") -> None:
        """Take over another ledger's contents; its head last: who has seen that sees all that belongs to it."""
        self.cases, self.operations, self.images = after.cases, after.operations, after.images
        self.computations, self._decided, self._pending = after.computations, after._decided, after._pending
        self.robot = after.robot
        self.head_sequence = after.head_sequence

    def open_case(self) -> Case | None:
        """The case that is open in this room, if any."""
        return next((c for c in reversed(self.cases.values()) if not c.progress.closed), None)

    def inside(self) -> tuple[Inside, ...]:
        """What is in the guide or the bone beside the robot: of the open case, or left there by the one before."""
        newest = self.open_case() or next(reversed(self.cases.values()), None)
        return () if newest is None else tuple(sorted(newest.inside_beside_robot))

    def pending_operations(self) -> tuple[Operation, ...]:
        """Operations that have not ended."""
        return self._pending

    def pending_computations(self) -> tuple[Computation, ...]:
        """Computations that have not ended."""
        return tuple(c for c in self.computations.values() if not c.ended)

    def case_after(self, case_id: str, events: Sequence[Event]) -> Case:
        """A case as it will be after events that have not been taken yet; raises `KeyError` when there is none."""
        case = self.cases.get(case_id)
        for event in events:
            if event.case_id == case_id:
                case = _case_with(case, event, self.robot)
        if case is None:
            raise KeyError(case_id)
        return case

    def decided(self, case_id: str, events: Sequence[Event] = ()) -> int:
        """Number of the last event by which somebody has decided something in a case; with events not taken yet."""
        newer = [event.sequence for event in events if event.case_id == case_id and _decides(event)]
        return newer[-1] if newer else self._decided.get(case_id, 0)

    def _take_decision(self, event: Event) -> None:
        if event.case_id is not None and _decides(event):
            self._decided = {**self._decided, event.case_id: event.sequence}

    def _take_case(self, event: Event) -> None:
        if event.case_id is None:
            return
        case = _case_with(self.cases.get(event.case_id), event, self.robot)
        if case is not None:
            held = case if self.images_held is None else case.holding(self.images_held)
            self.cases = {**self.cases, event.case_id: held}

    def _take_image(self, event: Event) -> None:
        data = event.data
        if isinstance(data, ImageReceived) and data.store_id is not None and data.sequence is not None:
            self._note_image(data.store_id, data.sequence)
        elif isinstance(data, CasePruned):
            for kept in data.image_numbers:
                for first, last in kept.ranges:
                    for number in range(first, last + 1):
                        self._note_image(kept.store_id, number)

    def _note_image(self, store_id: str, number: int) -> None:
        numbers = self.images.get(store_id, NumbersOnRecord()).with_number(number)
        self.images = {**self.images, store_id: numbers}

    def _take_operation(self, event: Event) -> None:
        data = event.data
        if isinstance(data, OperationRequested):
            operation = Operation(data, event.case_id, event.at_ns)
        elif isinstance(data, OperationProgressed):
            operation = progressed(self.operations[data.operation_id], data)
        elif isinstance(data, OperationEnded):
            operation = ended(self.operations[data.operation_id], data, event.at_ns)
        else:
            return
        self.operations = {**self.operations, data.operation_id: operation}
        before = {other.requested.operation_id: other for other in self._pending}
        after = {**before, data.operation_id: operation}
        self._pending = tuple(other for other in after.values() if not other.ended)

    def _take_computation(self, event: Event) -> None:
        data = event.data
        if isinstance(data, ComputationRequested):
            computation = Computation(data, event.case_id, event.at_ns)
        elif isinstance(data, ComputationProgressed):
            computation = computations.progressed(self.computations[data.operation_id], data)
        elif isinstance(data, ComputationEnded):
            computation = computations.ended(self.computations[data.operation_id], data, event.at_ns)
        else:
            return
        self.computations = {**self.computations, data.operation_id: computation}


def _case_with(case: Case | None, event: Event, robot: RobotWatch) -> Case | None:
    if isinstance(event.data, CaseOpened):
        return opened_case(event, event.data, robot)
    return None if case is None else applied(case, event)


def _decides(event: Event) -> bool:
    return event.kind not in _DECIDES_NOTHING
