"""Alarm conditions and their priorities, as one table (IEC 60601-1-8, table 1). Pure; `docs/risk/alarms.md` prints it.

The priority follows from what may come of it when nobody responds, and how soon. An alarm lasts as long as its
condition: none is latched here, because a stop and a fault are latched by the robot.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from services.ui_api.core.situation import Pending, RobotCondition


class Priority(StrEnum):
    """How urgent, the most urgent first."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"


class Result(StrEnum):
    """What may come of it when nobody responds."""

    IRREVERSIBLE = "death or irreversible injury"
    REVERSIBLE = "reversible injury"
    MINOR = "minor injury, discomfort or delay"


class Onset(StrEnum):
    """How soon that may come."""

    IMMEDIATE = "immediate"
    PROMPT = "prompt"
    DELAYED = "delayed"


PRIORITY: Final[Mapping[tuple[Result, Onset], Priority]] = {
    (Result.IRREVERSIBLE, Onset.IMMEDIATE): Priority.HIGH,
    (Result.IRREVERSIBLE, Onset.PROMPT): Priority.HIGH,
    (Result.IRREVERSIBLE, Onset.DELAYED): Priority.MEDIUM,
    (Result.REVERSIBLE, Onset.IMMEDIATE): Priority.HIGH,
    (Result.REVERSIBLE, Onset.PROMPT): Priority.MEDIUM,
    (Result.REVERSIBLE, Onset.DELAYED): Priority.LOW,
    (Result.MINOR, Onset.IMMEDIATE): Priority.MEDIUM,
    (Result.MINOR, Onset.PROMPT): Priority.LOW,
    (Result.MINOR, Onset.DELAYED): Priority.LOW,
}


@dataclass(frozen=True, slots=True)
class AlarmSituation:
    """What decides which alarms there are.

    Attributes
    ----------
    something_inside
        A wire, drill or screw is reported in guide or bone.
    side_agrees
        The images of the open case state no other side than the case.
    lacks
        Parts of `readyz` that are not well, each with what was measured.
    """

    robot: RobotCondition
    pending: Pending
    case_is_open: bool
    something_inside: bool
    side_agrees: bool
    lacks: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class AlarmCondition:
    """One row of the table.

    Attributes
    ----------
    means
        The condition in words.
    parts
        Parts of `readyz` whose measurements are quoted.
    """

    code: str
    means: str
    result: Result
    onset: Onset
    remedy: str
    holds: Callable[[AlarmSituation], bool]
    parts: tuple[str, ...] = ()

    @property
    def priority(self) -> Priority:
        """From result and onset."""
        return PRIORITY[self.result, self.onset]


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm condition that holds, with what was measured where something was."""

    condition: AlarmCondition
    measured: str


_LOST: Final = frozenset({RobotCondition.ABSENT, RobotCondition.STALE, RobotCondition.DISCONNECTED})


def _lost_in_motion(s: AlarmSituation) -> bool:
    return s.robot in _LOST and s.pending is not Pending.NOTHING


def _moves_with_something_inside(s: AlarmSituation) -> bool:
    return s.robot is RobotCondition.UNDER_WAY and s.something_inside


def _lost_at_rest(s: AlarmSituation) -> bool:
    return s.robot in _LOST and s.pending is Pending.NOTHING and s.case_is_open


def _lacks(*parts: str) -> Callable[[AlarmSituation], bool]:
    return lambda s: any(part in s.lacks for part in parts)


TABLE: Final = (
    AlarmCondition(
        "robot_lost_in_motion",
        "The robot reports nothing while it may be moving",
        Result.REVERSIBLE,
        Onset.IMMEDIATE,
        "stop it, and press the stop button on its controller",
        _lost_in_motion,
        ("robot", "robot_state", "bus"),
    ),
    AlarmCondition(
        "motion_with_something_inside",
        "The robot moves while a wire, drill or screw is in guide or bone",
        Result.REVERSIBLE,
        Onset.IMMEDIATE,
        "stop it",
        _moves_with_something_inside,
    ),
    AlarmCondition(
        "other_side",
        "The images state another side than the case",
        Result.IRREVERSIBLE,
        Onset.DELAYED,
        "see which side it is; correct the case, or the patient's data at the C-arm",
        lambda s: s.case_is_open and not s.side_agrees,
    ),
    AlarmCondition(
        "robot_fault",
        "The robot is in fault: do not rely on the guide",
        Result.REVERSIBLE,
        Onset.PROMPT,
        "see to the cause, reset, and take a new image",
        lambda s: s.robot is RobotCondition.FAULT,
        ("robot_state",),
    ),
    AlarmCondition(
        "robot_lost",
        "The robot, at rest, is not supervised: nobody would notice a guide that gives way",
        Result.REVERSIBLE,
        Onset.PROMPT,
        "see to its service, the controller's power and cable, and the link; do not drill before",
        _lost_at_rest,
        ("robot", "robot_state", "bus"),
    ),
    AlarmCondition(
        "stop_button",
        "The stop button on the controller is pressed",
        Result.MINOR,
        Onset.PROMPT,
        "release it once its cause is known, then acknowledge the stop",
        lambda s: s.case_is_open and s.robot is RobotCondition.BUTTON_PRESSED,
    ),
    AlarmCondition(
        "stop_in_force",
        "A stop is in force in an open case",
        Result.MINOR,
        Onset.PROMPT,
        "look why, then acknowledge it",
        lambda s: s.case_is_open and s.robot is RobotCondition.STOPPED,
    ),
    AlarmCondition(
        "record_takes_nothing",
        "The case record takes nothing",
        Result.MINOR,
        Onset.PROMPT,
        "see to the disk of the state folder or to the database",
        _lacks("database", "gateway"),
        ("database", "gateway"),
    ),
    AlarmCondition(
        "imaging_impaired",
        "Images are not received, calibrated or localised",
        Result.MINOR,
        Onset.PROMPT,
        "see what the part says; then take the image again",
        _lacks("imaging", "registration"),
        ("imaging", "registration"),
    ),
    AlarmCondition(
        "disk",
        "The disk is full or fills",
        Result.MINOR,
        Onset.DELAYED,
        "free some space before the next case",
        _lacks("disk"),
        ("disk",),
    ),
)


def active_alarms(situation: AlarmSituation) -> tuple[Alarm, ...]:
    """Every condition that holds, the most urgent first."""
    held = [Alarm(row, _measured(row, situation)) for row in TABLE if row.holds(situation)]
    order = list(Priority)
    return tuple(sorted(held, key=lambda alarm: order.index(alarm.condition.priority)))


def _measured(row: AlarmCondition, situation: AlarmSituation) -> str:
    return "; ".join(f"{part}: {situation.lacks[part]}" for part in row.parts if part in situation.lacks)
