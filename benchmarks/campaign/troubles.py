"""What goes wrong in a procedure: drawn from its seed, by people, in the images, in the hardware."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, TypeVar

import numpy as np

from benchmarks.campaign.rows import Moment
from benchmarks.robustness.foreign_objects import DRAWS
from benchmarks.robustness.processing import OPERATORS
from simulation.controller.faults import Fault

T = TypeVar("T")


class Error(StrEnum):
    """What people do wrong."""

    NONE = ""
    WRONG_SIDE = "case opened for the other side"
    WRONG_NAIL = "case names another nail"
    WRONG_EXTENSION = "head extension misread"
    GUIDE_TURNED = "guide mounted the wrong way round"
    LOOSE_MOUNT = "mount slips"
    MOVED_LEG = "leg moves while an image is taken"
    EARLY_DRILL = "drill before the verification"
    WIRE_INSIDE = "wire in the guide when the robot is to move"
    STOP_PRESSED = "stop asked for in motion"
    OLD_IMAGE = "plan used ten minutes later"


@dataclass(frozen=True, slots=True)
class Troubles:
    """What goes wrong in one procedure.

    Attributes
    ----------
    error_at
        Before which step the mount slips; of other errors their own step.
    size
        How large the error is: millimetres of a slip or of an extension, pixels of a smear.
    heeds
        Whether people do what a refusal says, or go on where the system lets them.
    operator, thing
        What the display does to all images; what lies in the beam until an image is refused. Empty for nothing.
    dose
        Share of the usual dose.
    fault, fault_at, fault_lasts_s
        Of the controller or its line; in a motion when `fault_at` is the move.
    """

    error: Error
    error_at: Moment
    size: float
    heeds: bool
    operator: str
    thing: str
    dose: float
    fault: Fault | None
    fault_at: Moment
    fault_lasts_s: float

    @property
    def image(self) -> str:
        """What is wrong with the images, in words."""
        named = [self.operator, self.thing, "low dose" if self.dose < 1.0 else ""]
        return ", ".join(name for name in named if name)


_SOME_ERROR: Final = 0.6
_PROCESSED, _CLUTTERED, _LOW_DOSE = 0.25, 0.15, 0.10
_SOME_FAULT: Final = 0.3
_HEEDS: Final = 0.7
_SLIP_MM: Final = (0.5, 6.0)
_EXTENSION_MM: Final = (4.0, 20.0)
_SMEAR_PX: Final = (2.0, 15.0)
_SIZES: Final[Mapping[Error, tuple[float, float]]] = {
    Error.LOOSE_MOUNT: _SLIP_MM,
    Error.WRONG_EXTENSION: _EXTENSION_MM,
    Error.MOVED_LEG: _SMEAR_PX,
}
_AT: Final[Mapping[Error, tuple[Moment, ...]]] = {
    Error.LOOSE_MOUNT: (Moment.IMAGE, Moment.PLAN, Moment.MOVE, Moment.VERIFY, Moment.DRILL),
    Error.MOVED_LEG: (Moment.IMAGE, Moment.VERIFY),
    Error.EARLY_DRILL: (Moment.PLAN, Moment.VERIFY),
    Error.WIRE_INSIDE: (Moment.MOVE,),
    Error.STOP_PRESSED: (Moment.MOVE,),
    Error.OLD_IMAGE: (Moment.PLAN, Moment.MOVE),
}
_FAULT_AT: Final = (Moment.PREPARE, Moment.IMAGE, Moment.MOVE, Moment.MOVE, Moment.MOVE, Moment.DRILL)
_FAULT_LASTS_S: Final = (0.3, 3.0)
# A stop button is no fault of the hardware, and is pressed as one all the same.
_FAULTS: Final = tuple(Fault)


def troubles_of(seed: int) -> Troubles:
    """Draw what goes wrong; each of the three is drawn by itself."""
    draw = np.random.default_rng([seed, *b"campaign"])
    error = _one(draw, tuple(Error)[1:]) if draw.random() < _SOME_ERROR else Error.NONE
    low, high = _SIZES.get(error, (0.0, 0.0))
    return Troubles(
        error=error,
        error_at=_one(draw, _AT.get(error, (Moment.OPEN,))),
        size=float(draw.uniform(low, high)),
        heeds=bool(draw.random() < _HEEDS),
        operator=_one(draw, tuple(OPERATORS)) if draw.random() < _PROCESSED else "",
        thing=_one(draw, tuple(one.__name__ for one in DRAWS)) if draw.random() < _CLUTTERED else "",
        dose=float(draw.uniform(0.1, 0.6)) if draw.random() < _LOW_DOSE else 1.0,
        fault=_one(draw, _FAULTS) if draw.random() < _SOME_FAULT else None,
        fault_at=_one(draw, _FAULT_AT),
        fault_lasts_s=float(draw.uniform(*_FAULT_LASTS_S)),
    )


def _one(draw: np.random.Generator, choices: tuple[T, ...]) -> T:
    return choices[int(draw.integers(len(choices)))]
