"""A case's log, and the events that tests of it write."""

from dataclasses import dataclass, field

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived, LocalisationReceived, PlanMade
from services.ui_api.core.events import Event, EventData
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.robot_event_data import CommandVerb, OperationEnded, OperationRequested, OperationStatus
from tests.unit.services.ui_api import samples


@dataclass(slots=True)
class Log:
    """Takes events in the order in which they are written."""

    ledger: Ledger = field(default_factory=Ledger)

    @property
    def case(self) -> Case:
        return self.ledger.cases["case-1"]

    def add(self, *data: EventData) -> Case:
        for each in data:
            sequence = self.ledger.head_sequence + 1
            self.ledger.take(Event(sequence, sequence, "case-1", "test", "", each))
        return self.case


def image(name: str, number: int | None = None, revision: int = 1) -> ImageReceived:
    """An image; with its number where imaging gave it one."""
    store_id = None if number is None else "store"
    return ImageReceived(samples.sha(name), "1.2", 1, revision, None, store_id, number)


def localised(number: int, name: str, revision: int = 1) -> LocalisationReceived:
    return LocalisationReceived(number, samples.sha(name), revision, f"r.{number}", "accepted", (), "d" * 64, None)


def plan(number: int, name: str) -> PlanMade:
    return PlanMade(number, 1, ("distal",), "f" * 64, samples.sha(name), 1)


def asked_for(verb: CommandVerb, operation_id: str) -> OperationRequested:
    """A command to the robot; a move is of plan 1."""
    number, sha256 = (1, "f" * 64) if verb == "move" else (None, None)
    return OperationRequested(operation_id, verb, number, sha256, False, "boot-1", 1, 1, None, 1.0)


def ended(
    operation_id: str, status: OperationStatus = OperationStatus.SUCCEEDED, *, began: bool = True
) -> OperationEnded:
    return OperationEnded(operation_id, status, began, "", "")
