"""How far an operation has come, as a step of so many, in words, and as a fraction where that is known. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from services.ui_api.core.computations import STEPS, Computation
from services.ui_api.core.localising import Localising
from services.ui_api.core.operations import Operation
from services.ui_api.core.robot_event_data import CommandVerb, OperationStatus
from shared.geometry.hexapod import PlatformPose

_MOVE: Final = "move"
_CARRIED_OUT: Final[Mapping[CommandVerb, str]] = {
    "move": "the robot moves",
    "reference": "the robot references its axes",
    "acknowledge_stop": "the robot releases the stop",
    "reset": "the robot connects anew",
}
_ENDED: Final = "has ended: {status}"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far.

    Attributes
    ----------
    step, steps
        Which step of how many, from 1.
    says
        What is done in it.
    fraction
        Of the whole, 0 to 1; None where nobody knows.
    """

    step: int
    steps: int
    says: str
    fraction: float | None = None


def share_of_way(start: PlatformPose, target: PlatformPose, here: PlatformPose) -> float:
    """The share of a straight move that lies behind a pose, 0 to 1."""
    first, along = start.as_array(), target.as_array() - start.as_array()
    length_squared = float(along @ along)
    if length_squared == 0.0:
        return 1.0
    return float(np.clip((here.as_array() - first) @ along / length_squared, 0.0, 1.0))


def progress_of_operation(operation: Operation, share: float | None = None) -> Progress:
    """Of a command to the robot; `share` of a move's way lies behind it."""
    moves = operation.requested.verb == _MOVE
    match operation.status:
        case OperationStatus.REQUESTED:
            return Progress(1, STEPS, "on its way to the robot", 0.0 if moves else None)
        case OperationStatus.UNKNOWN:
            return Progress(1, STEPS, "the robot has not answered; its state will tell")
        case OperationStatus.RUNNING:
            return Progress(2, STEPS, _CARRIED_OUT[operation.requested.verb], share if moves else None)
        case _:
            reached = operation.status is OperationStatus.SUCCEEDED
            return Progress(STEPS, STEPS, _ENDED.format(status=operation.status), 1.0 if reached else None)


def progress_of_localising(localising: Localising) -> Progress:
    """Of an image on its way to its localisation."""
    return Progress(localising.step, STEPS, localising.says, 1.0 if localising.result is not None else None)


def progress_of_computation(computation: Computation) -> Progress:
    """Of a computation."""
    if computation.ended:
        made = 1.0 if computation.result is not None else None
        return Progress(STEPS, STEPS, _ENDED.format(status=computation.status), made)
    return Progress(computation.step, STEPS, computation.says)
