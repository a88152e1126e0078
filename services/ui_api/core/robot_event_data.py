"""What events of the robot and of commands to it say: one frozen dataclass per kind."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

CommandVerb = Literal["move", "reference", "acknowledge_stop", "reset"]


class OperationStatus(StrEnum):
    """How far a command to the robot has come."""

    REQUESTED = "requested"
    RUNNING = "running"
    UNKNOWN = "unknown"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class OperationRequested:
    """A command is about to be sent to the robot. Recorded before it is sent: it is never sent twice.

    Attributes
    ----------
    operation_id
        Also the command's id.
    plan_number, plan_sha256
        Of a move; None otherwise.
    hold_to_move
        Whether motion lasts only as long as a lease is renewed.
    robot_boot_epoch, after_state_sequence, state_clock_s, previous_command_id
        From the newest robot state before sending: what decides, later, whether the command can still take effect. The
        clock is the robot's own monotonic one; records of older versions have none.
    state_sent_at_ns
        Wall clock of that state, for people.
    time_to_live_s
        How long after that state the robot may begin.
    approver
        Who approved the plan of a move, or asked for a reference; None of commands that move nothing.
    authenticated_by
        How the approver showed who he is (`core.identity.Authenticated`); None in older records.
    permit_sha256, permit_signature, permit_key_sha256
        The permit that went with it: the hash of its text (kept as a document), the signature, and the hash of the
        public key. Records of older versions have none.
    """

    operation_id: str
    verb: CommandVerb
    plan_number: int | None
    plan_sha256: str | None
    hold_to_move: bool
    robot_boot_epoch: str
    after_state_sequence: int
    state_sent_at_ns: int
    previous_command_id: str | None
    time_to_live_s: float
    state_clock_s: float | None = None
    approver: str | None = None
    permit_sha256: str | None = None
    permit_signature: str | None = None
    permit_key_sha256: str | None = None
    authenticated_by: str | None = None


@dataclass(frozen=True, slots=True)
class OperationProgressed:
    """The robot began, or did not answer (`unknown`)."""

    operation_id: str
    status: OperationStatus
    message: str


@dataclass(frozen=True, slots=True)
class OperationEnded:
    """The operation is over. `began` is False only when the robot certainly never carried it out."""

    operation_id: str
    status: OperationStatus
    began: bool
    code: str
    message: str
    deviation_mm: float | None = None
    deviation_deg: float | None = None


@dataclass(frozen=True, slots=True)
class StopRequested:
    """Stop was sent to the robot."""

    reason: str
    confirmed: bool
    message: str


@dataclass(frozen=True, slots=True)
class RobotChanged:
    """The robot's condition changed (its pose alone makes no event): also that it took a permit, or refused one."""

    boot_epoch: str
    state: str
    stop: str
    locked: bool
    referenced: bool
    command_id: str | None
    outcome: str
    detail: str
    controller_identity: str
    permit_sha256: str | None = None
    permits_refused: int = 0
    permit_refusal: str = ""
