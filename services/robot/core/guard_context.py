"""All that counts at the moment of decision about a move."""

from dataclasses import dataclass

from services.robot.core.controller_feedback import ControllerFeedback
from services.robot.core.deviation import Deviation
from services.robot.core.plans import RegistrationView
from shared.geometry.hexapod import HexapodPart
from shared.robot_states import StopButton


@dataclass(frozen=True, slots=True)
class GuardLimits:
    """What a single move may be, and how old what it rests on.

    Attributes
    ----------
    step
        Greatest move: the pivot's displacement and the angle of rotation.
    plan_lifetime_s
        Longest time from the arrival of a plan to its execution.
    heartbeat_deadline_s
        Longest silence of the gateway, before and during a move.
    registration_deadline_s
        Longest silence of registration before a move: nobody else knows whether a newer image has arrived.
    """

    step: Deviation
    plan_lifetime_s: float
    heartbeat_deadline_s: float
    registration_deadline_s: float


@dataclass(frozen=True, slots=True, eq=False)
class GuardContext:
    """All that the robot service knows at the moment of decision.

    Attributes
    ----------
    now_s, heartbeat_s, connected_s
        Own monotonic clock: now, when the gateway was last heard, when the controller was connected.
    executed
        Hashes of the plans that were begun.
    """

    boot_epoch: str
    now_s: float
    hexapod: HexapodPart
    limits: GuardLimits
    registration: RegistrationView
    feedback: ControllerFeedback | None
    connected_s: float
    heartbeat_s: float | None
    link_up: bool
    executed: frozenset[str]
    stop_button: StopButton = StopButton.CLEAR
