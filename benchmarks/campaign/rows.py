"""What a procedure of the campaign came to."""

from dataclasses import dataclass
from enum import StrEnum


class Ending(StrEnum):
    """How a procedure ended; the first that applies."""

    HARM = "harm"
    CRASHED = "crashed"
    AGAINST_ADVICE = "against advice"
    STOPPED = "stopped"
    REFUSED = "refused"
    DRILLED = "drilled right"


class Moment(StrEnum):
    """What was to be done next when something happened or was noticed: the steps of the FMEA."""

    OPEN = "open the case"
    PREPARE = "prepare the robot"
    IMAGE = "take and localise an image"
    PLAN = "plan and approve"
    MOVE = "move"
    VERIFY = "verify"
    DRILL = "drill"


@dataclass(frozen=True, slots=True)
class Noticed:
    """The system said no, or stopped: at which step, by which code, in which words."""

    moment: Moment
    code: str
    sentence: str


@dataclass(frozen=True, slots=True)
class DrilledHole:
    """Where the guide's axis was, by the room's truth, when the hole was drilled.

    Attributes
    ----------
    allowed
        The system had said that this hole may be drilled.
    slipped
        Something moved after the system's last image, which nothing could see.
    """

    hole_id: str
    entry_mm: float
    angle_deg: float
    passed: bool
    allowed: bool
    slipped: bool


@dataclass(frozen=True, slots=True)
class CaseRow:
    """One procedure.

    Attributes
    ----------
    error, image, fault
        What went wrong by people, in the images and in the hardware; empty where nothing did.
    error_at, fault_at
        When.
    noticed
        Every refusal and stop, in order.
    why
        The last of them where the procedure did not end with drilled holes.
    harms
        What harmed, by the definitions of `harm.py`.
    stops
        How often the robot was stopped or in fault.
    """

    seed: int
    error: str
    error_at: str
    image: str
    fault: str
    fault_at: str
    ending: Ending
    why: str
    noticed: tuple[Noticed, ...]
    harms: tuple[str, ...]
    holes: tuple[DrilledHole, ...]
    images: int
    moves: int
    stops: int
    took_s: float
