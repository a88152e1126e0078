"""What the robot service says and accepts.

Commands take effect at most once and never late. Clocks of different hosts cannot be compared, so lateness is judged
by the robot's own clock alone: every `RobotState` carries a sequence number, every command quotes the newest number
its client has seen (`after_state_sequence`), and the robot refuses a command whose quoted state it published longer
ago than the command's time to live.
"""

from typing import Annotated, Literal

from pydantic import Field

from shared.geometry.hexapod import PlatformPose
from shared.messages.base import Finite, Identifier, Message, MessageModel, Sha256, UnixNanoseconds, Vector3
from shared.messages.permits import SignedPermit
from shared.robot_states import MotionState as MotionState
from shared.robot_states import StopButton as StopButton
from shared.robot_states import StopLatch as StopLatch
from shared.robot_states import Verb as Verb


class PlatformPoseMessage(MessageModel):
    """Platform pose as the controller counts it: X Y Z in mm, U V W in degrees, about the pivot."""

    x_mm: Finite
    y_mm: Finite
    z_mm: Finite
    u_deg: Finite
    v_deg: Finite
    w_deg: Finite

    @staticmethod
    def of(pose: PlatformPose) -> "PlatformPoseMessage":
        """From the core's value."""
        x, y, z, u, v, w = pose.as_array().tolist()
        return PlatformPoseMessage(x_mm=x, y_mm=y, z_mm=z, u_deg=u, v_deg=v, w_deg=w)

    def value(self) -> PlatformPose:
        """The core's value."""
        return PlatformPose(self.x_mm, self.y_mm, self.z_mm, self.u_deg, self.v_deg, self.w_deg)


class RobotState(Message):
    """Everything others may know of the robot, published on change and at a steady rate."""

    schema_name: Literal["distalock/robot-state/1"] = Field("distalock/robot-state/1", alias="schema")
    boot_epoch: Identifier
    sequence: int = Field(ge=0)
    sent_at_ns: UnixNanoseconds = Field(description="For people: never compared.")
    state: MotionState
    stop: StopLatch
    locked: bool = Field(description="Brake on and servo off, as read back from the controller.")
    referenced: bool
    pose: PlatformPoseMessage | None = Field(
        description="Null when it is not known; in `locked` or `stopped`: the controller has not answered in the last "
        "round, and `locked` and `referenced` are not known either."
    )
    leg_lengths_mm: tuple[Finite, Finite, Finite, Finite, Finite, Finite] | None
    pivot_mm: Vector3
    hexapod_sha256: Sha256
    controller_identity: str = Field("", description="What the controller answered to *IDN?.")
    registration_epoch: Identifier | None = Field(None, description="Newest epoch the robot has heard of.")
    command_id: Identifier | None = Field(None, description="Command being carried out, or the last one.")
    outcome: Literal["none", "moving", "reached", "stopped", "failed"] = Field(
        "none", description="How the command in `command_id` ended, or that it is under way."
    )
    deviation_mm: Finite | None = Field(None, description="Read-back minus target after the last move.")
    deviation_deg: Finite | None = None
    detail: str = ""
    clock_s: Finite | None = Field(
        None,
        description="Monotonic clock of the robot service when it sent this: compared only with that of another state "
        "of the same boot epoch.",
    )
    stop_button: StopButton = Field(StopButton.ABSENT, description="The controller's own button, as far as it says.")
    permit_sha256: Sha256 | None = Field(None, description="Hash of the permit that was taken last.")
    permits_refused: int = Field(0, ge=0, description="How many permits this run of the service has refused.")
    permit_refusal: str = Field("", description="Code with which the last of them was refused.")


class CommandEnvelope(MessageModel):
    """What every command carries so that it takes effect at most once and never late."""

    command_id: Identifier
    client: Identifier
    client_sequence: int = Field(ge=0)
    robot_boot_epoch: Identifier
    after_state_sequence: int = Field(ge=0)
    time_to_live_s: Annotated[float, Field(gt=0.0, le=2.0)] = 1.0
    issued_at_ns: UnixNanoseconds = Field(description="For the record only: never compared.")


class Approval(MessageModel):
    """A surgeon's consent to exactly one plan, as claimed by version 1 of a move."""

    plan_sha256: Sha256
    approved_by: str = Field(min_length=1, max_length=128)
    approved_at_ns: UnixNanoseconds


class MoveCommand(Message):
    """Move to the target of a plan. The robot knows the plan from registration; the permit is the gateway's."""

    schema_name: Literal["distalock/robot-move/2"] = Field("distalock/robot-move/2", alias="schema")
    envelope: CommandEnvelope
    plan_sha256: Sha256
    permit: SignedPermit


class MoveCommand1(Message):
    """Version 1 of a move: it carried the plan and a claim of its approval. It is still read, and moves nothing."""

    schema_name: Literal["distalock/robot-move/1"] = Field("distalock/robot-move/1", alias="schema")
    envelope: CommandEnvelope
    plan_json: str
    approval: Approval


class PlainCommand(Message):
    """A command without a plan: reference, acknowledge_stop, reset. A reference moves, and needs a permit."""

    schema_name: Literal["distalock/robot-command/1"] = Field("distalock/robot-command/1", alias="schema")
    verb: Literal["reference", "acknowledge_stop", "reset"]
    envelope: CommandEnvelope
    permit: SignedPermit | None = None


class StopCommand(Message):
    """Stop: needs no envelope, is never stale, never a repeat."""

    schema_name: Literal["distalock/robot-stop/1"] = Field("distalock/robot-stop/1", alias="schema")
    client: Identifier
    reason: str = ""


class StopReport(MessageModel):
    """What is known of a stop. The controller's answers count only when they were asked for after it was written."""

    written: bool = Field(description="Every byte of it was handed to the controller's line.")
    standstill: bool | None = Field(None, description="Nothing moves; null when the controller has not answered since.")
    locked: bool | None = Field(None, description="Brakes on and servos off, as read back; null like `standstill`.")

    @property
    def confirmed(self) -> bool:
        """Whether all of it is known."""
        return self.written and self.standstill is True and self.locked is True


class CommandReply(Message):
    """The robot's answer. `accepted` means begun, not ended: the outcome appears in `RobotState`.

    A stop is always accepted, and answered as soon as `stop` is confirmed, or after half a second.
    """

    schema_name: Literal["distalock/robot-reply/1"] = Field("distalock/robot-reply/1", alias="schema")
    command_id: Identifier | None
    verdict: Literal["accepted", "refused"]
    code: str = ""
    message: str = ""
    state: MotionState
    stop: StopReport | None = Field(None, description="In the answer to a stop alone.")
