"""What the record says of a command before it is sent: the operation, and the permit that goes with it."""

from dataclasses import dataclass, replace

from services.ui_api.core.identity import Approver
from services.ui_api.core.robot_event_data import CommandVerb, OperationRequested
from services.ui_api.handlers.permits import ApprovedPlan
from shared.messages.permits import SignedPermit
from shared.messages.robot import CommandEnvelope, RobotState


@dataclass(frozen=True, slots=True)
class Move:
    """What a motion command carries beside its envelope."""

    plan_number: int
    plan: ApprovedPlan
    hold_to_move: bool


def with_permit(requested: OperationRequested, permit: SignedPermit, approver: Approver) -> OperationRequested:
    """The same operation, with the permit that goes with it and who approved it."""
    return replace(
        requested,
        approver=approver.name,
        authenticated_by=approver.authenticated.value,
        permit_sha256=permit.permit_sha256,
        permit_signature=permit.signature,
        permit_key_sha256=permit.key_sha256,
    )


def requested_operation(
    envelope: CommandEnvelope, verb: CommandVerb, state: RobotState, move: Move | None
) -> OperationRequested:
    """A command that is about to be sent, quoting the newest state that was seen; `move` is None of all but moves."""
    return OperationRequested(
        operation_id=envelope.command_id,
        verb=verb,
        plan_number=move.plan_number if move else None,
        plan_sha256=move.plan.sha256 if move else None,
        hold_to_move=move.hold_to_move if move else False,
        robot_boot_epoch=envelope.robot_boot_epoch,
        after_state_sequence=envelope.after_state_sequence,
        state_sent_at_ns=state.sent_at_ns,
        previous_command_id=state.command_id,
        time_to_live_s=envelope.time_to_live_s,
        state_clock_s=state.clock_s,
    )
