"""What the robot service remembers between two events, as far as it decides anything."""

from dataclasses import dataclass, replace

from services.robot.core.motion import Effect
from services.robot.core.status import DriveStatus
from services.robot.core.supervision import MoveUnderWay
from tests.model.labels import NOW_S
from tests.model.plans import PlanName
from tests.model.plant import Doing, Plant


@dataclass(frozen=True, slots=True)
class Reply:
    """The robot's answer to a command."""

    verdict: str
    code: str


@dataclass(frozen=True, slots=True)
class RobotMemory:
    """All that the robot service remembers and that may decide anything later.

    Attributes
    ----------
    status
        Without the sentences for people, with its times set to the class that they are of.
    pending
        What the worker has still to do.
    connected
        Whether a controller is connected.
    answers
        Commands on record whose message may still arrive: identifier, effect, answer.
    newest
        Of each client, the number of the newest command that was admitted.
    plan
        Plan that registration published last, and whether it was begun.
    inside
        Whether something is in guide or bone, by what was heard of the case.
    used
        Permits that were taken, and whether the state that each quotes was published before time passed.
    forgets_stop
        Whether a stop has come that the service has not counted.
    heard
        Run of the gateway of which a heartbeat came within the deadline.
    """

    status: DriveStatus
    pending: tuple[Effect, ...]
    connected: bool
    answers: tuple[tuple[str, str, Reply | None], ...]
    newest: tuple[tuple[str, int], ...]
    plan: PlanName
    begun: bool
    inside: bool
    used: tuple[tuple[str, bool], ...]
    heard: str | None
    forgets_stop: bool = False


@dataclass(frozen=True, slots=True)
class Ran:
    """What came of an event.

    Attributes
    ----------
    began
        Motions that the hexapod began.
    taken
        Permits that were taken.
    stopped
        Whether the hexapod was stopped.
    """

    memory: RobotMemory
    plant: Plant
    reply: Reply | None
    began: tuple[Doing, ...]
    taken: tuple[str, ...]
    stopped: bool


def plain_status(status: DriveStatus) -> DriveStatus:
    """Without sentences, counters and times: feedback either describes the present state or not."""
    is_fresh = status.feedback is not None and status.feedback_generation == status.generation
    task = status.task if status.outcome == "moving" else None
    if isinstance(task, MoveUnderWay):
        task = replace(task, at_rest_s=None if task.at_rest_s is None else NOW_S)
    return replace(
        status,
        detail="",
        generation=0,
        stops=0,
        feedback_generation=0 if is_fresh else -1,
        feedback=status.feedback if is_fresh else None,
        feedback_s=NOW_S,
        connected_s=0.0,
        task=task,
        deviation=None,
        readback=None,
    )
