"""What a race of two surgeons must leave behind. Pure: from answers, the controller's line and the record's events."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Final, Literal

ActionName = Literal["approve", "move", "undo", "stop"]
# A refusal for the state of things; what is missing, malformed or unauthenticated would be this benchmark's own fault.
_REFUSED: Final = (HTTPStatus.CONFLICT, HTTPStatus.PRECONDITION_FAILED)


@dataclass(frozen=True, slots=True)
class Answer:
    """One request and what was answered.

    Attributes
    ----------
    key
        Idempotency key; a repeat has that of the first. Empty where the operation takes none.
    body
        As it came, without what changes from answer to answer.
    """

    surgeon: str
    action: ActionName
    key: str
    status: int
    code: str
    detail: str
    body: str

    @property
    def succeeded(self) -> bool:
        """Whether it was done."""
        return self.status < HTTPStatus.MULTIPLE_CHOICES


@dataclass(frozen=True, slots=True)
class Commanded:
    """Something that went to the controller that moves it, or stops it."""

    at_s: float
    what: Literal["move", "stop"]


@dataclass(frozen=True, slots=True)
class MoveOperation:
    """A motion that was asked for; `began` is None while nobody knows."""

    id: str
    ended: bool
    began: bool | None


@dataclass(frozen=True, slots=True)
class Race:
    """Everything that one race left behind.

    Attributes
    ----------
    latched
        Whether the robot says afterwards that a stop is in force.
    at_rest
        Whether the hexapod stands still, by the virtual room's own truth.
    """

    answers: tuple[Answer, ...]
    commanded: tuple[Commanded, ...]
    operations: tuple[MoveOperation, ...]
    latched: bool
    at_rest: bool


def faults_of(race: Race, documented: Container[str]) -> list[str]:
    """What is wrong; `documented` are the codes of refusals that the documents name."""
    return [
        *_unclear_answers(race.answers, documented),
        *_unequal_repeats(race.answers),
        *_too_many_motions(race),
        *_stops_that_lost(race),
    ]


def _unclear_answers(answers: Sequence[Answer], documented: Container[str]) -> list[str]:
    found = []
    for one in answers:
        if one.succeeded:
            continue
        said = f"{one.surgeon}: {one.action} was answered {one.status} {one.code}: {one.detail}"
        if one.status not in _REFUSED or one.action == "stop":
            found.append(said)
        elif not one.detail or one.code not in documented:
            found.append(f"{said} (on no page, or without a reason)")
    return found


def _unequal_repeats(answers: Sequence[Answer]) -> list[str]:
    first: dict[str, Answer] = {}
    found = []
    for one in answers:
        known = first.setdefault(one.key, one)
        if one.key and (known.status, known.body) != (one.status, one.body):
            found.append(f"{one.surgeon}: the repeat of {one.action} was answered {one.status}, not {known.status}")
    return found


def _too_many_motions(race: Race) -> list[str]:
    moves = sum(one.what == "move" for one in race.commanded)
    began = sum(one.began is not False for one in race.operations)
    found = [f"operation {one.id} has not ended" for one in race.operations if not one.ended]
    if moves > 1:
        found.append(f"{moves} motions went to the controller for one plan")
    if moves > began:  # fewer: a stop came between brakes and servos and the command to move
        found.append(f"{moves} motions went to the controller, and {began} operations say that they began")
    return found


def _stops_that_lost(race: Race) -> list[str]:
    if not any(one.action == "stop" and one.succeeded for one in race.answers):
        return []
    found = []
    stops = [one.at_s for one in race.commanded if one.what == "stop"]
    if not stops:
        found.append("a stop was confirmed, and no stop byte went to the controller")
    if any(one.what == "move" and one.at_s > min(stops, default=float("inf")) for one in race.commanded):
        found.append("a motion went to the controller after a stop")
    if not (race.latched and race.at_rest):
        found.append("a stop was confirmed, and the robot is not at rest with the stop in force")
    return found


@dataclass(frozen=True, slots=True)
class Recorded:
    """An event of the record, as far as it counts here."""

    kind: str
    plan: int | None
    verb: str | None = None


def record_faults(events: Sequence[Recorded], answers: Sequence[Answer]) -> list[str]:
    """What the record has that no answer speaks of, the other way round, and motions that nobody had approved."""
    found, approved = [], set[int | None]()
    for event in events:
        match event.kind:
            case "plan_approved":
                approved.add(event.plan)
            case "approval_withdrawn":
                approved.discard(event.plan)
            case "operation_requested" if event.verb == "move" and event.plan not in approved:
                found.append(f"a motion from plan {event.plan} is on record, which nobody had approved then")
    done = _done(answers)
    on_record = {
        "approve": sum(event.kind == "plan_approved" for event in events),
        "undo": sum(event.kind == "approval_withdrawn" for event in events),
        "move": sum(event.kind == "operation_requested" and event.verb == "move" for event in events),
        "stop": sum(event.kind == "stop_requested" for event in events),
    }
    found += [
        f"{done[action]} times {action} was answered with success, and the record has {count}"
        for action, count in on_record.items()
        if done[action] != count
    ]
    return found


def _done(answers: Sequence[Answer]) -> Mapping[str, int]:
    """How often each action was done: a repeat is no second time."""
    done = [one for one in answers if one.succeeded]
    return {
        action: len({one.key for one in done if one.action == action and one.key})
        + sum(one.action == action and not one.key for one in done)
        for action in ("approve", "undo", "move", "stop")
    }
