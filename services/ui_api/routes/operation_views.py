"""What clients get of operations: commands to the robot, and what is computed while nobody waits for it."""

from collections.abc import Mapping
from typing import Final, Literal, assert_never

from pydantic import Field

from services.ui_api.core.computations import Computation
from services.ui_api.core.localising import VERB, Localising
from services.ui_api.core.operations import VERBS_WITH_A_MOTION, Operation
from services.ui_api.core.progress import (
    Progress,
    progress_of_computation,
    progress_of_localising,
    progress_of_operation,
)
from services.ui_api.core.robot_event_data import OperationStatus
from services.ui_api.routes.views import View
from shared.messages.base import Sha256, UnixNanoseconds

OperationStatusName = Literal["running", "unknown", "succeeded", "failed", "stopped", "cancelled"]
EndedBy = Literal["cancel", "stop"]
AnyOperation = Operation | Computation | Localising
# To a client, a command on its way to the robot and one that the robot carries out are both under way.
_STATUS_NAMES: Final[Mapping[OperationStatus, OperationStatusName]] = {
    OperationStatus.REQUESTED: "running",
    OperationStatus.RUNNING: "running",
    OperationStatus.UNKNOWN: "unknown",
    OperationStatus.SUCCEEDED: "succeeded",
    OperationStatus.FAILED: "failed",
    OperationStatus.STOPPED: "stopped",
}


class ProgressView(View):
    """How far an operation has come."""

    step: int = Field(description="Which of the steps, from 1.")
    steps: int
    says: str = Field(description="What is done in this step.")
    fraction: float | None = Field(
        ge=0.0,
        le=1.0,
        description="Of the whole: of a move, the share of its way that lies behind it; null where nobody knows.",
    )

    @staticmethod
    def of(progress: Progress) -> "ProgressView":
        """From the core's value."""
        return ProgressView(step=progress.step, steps=progress.steps, says=progress.says, fraction=progress.fraction)


class OperationView(View):
    """What takes time, and how far it has come; `began` is null while nobody knows.

    A command to the robot (`move`, `reference`, `acknowledge_stop`, `reset`), something that is computed (`verify`,
    `report_quality`, `plan`), or an image on its way to its localisation (`localise`), for which nobody asks.
    """

    id: str
    verb: str
    case_id: str | None
    plan: int | None
    hold_to_move: bool
    status: OperationStatusName = Field(
        description="`unknown`: the robot has not answered; its state will tell. The last four are final."
    )
    progress: ProgressView
    ended_by: EndedBy | None = Field(
        description="How it can be ended now: `cancel` (POST /operations/{id}/cancel), or `stop` (POST /robot/stop) of "
        "what moves the robot; null of what has ended, or takes but a moment."
    )
    began: bool | None
    code: str
    detail: str
    result: str | None = Field(description="Path of what was computed, once it has succeeded.")
    deviation_mm: float | None = Field(description="Read-back minus target, once the move has ended.")
    deviation_deg: float | None
    requested_at_ns: UnixNanoseconds
    ended_at_ns: UnixNanoseconds | None
    approver: str | None = Field(description="Who approved the plan, or asked for the reference.")
    authenticated_by: str | None = Field(description="How the approver showed who he is.")
    permit_sha256: Sha256 | None = Field(description="The permit that went with it: its text's hash.")

    @staticmethod
    def of(operation: AnyOperation, progress: Progress | None = None) -> "OperationView":
        """From the ledger's value; `progress` where more is known of it than it says itself."""
        match operation:
            case Operation():
                return _of_command(operation, progress or progress_of_operation(operation))
            case Computation():
                return _of_computation(operation)
            case Localising():
                return _of_localising(operation)
            case _:
                assert_never(operation)


def _of_command(operation: Operation, progress: Progress) -> OperationView:
    requested = operation.requested
    return OperationView(
        id=requested.operation_id,
        verb=requested.verb,
        case_id=operation.case_id,
        plan=requested.plan_number,
        hold_to_move=requested.hold_to_move,
        status=status_name(operation),
        progress=ProgressView.of(progress),
        ended_by="stop" if requested.verb in VERBS_WITH_A_MOTION and not operation.ended else None,
        began=operation.began,
        code=operation.code,
        detail=operation.message,
        result=None,
        deviation_mm=operation.deviation_mm,
        deviation_deg=operation.deviation_deg,
        requested_at_ns=operation.requested_at_ns,
        ended_at_ns=operation.ended_at_ns,
        approver=requested.approver,
        authenticated_by=requested.authenticated_by,
        permit_sha256=requested.permit_sha256,
    )


def _of_computation(computation: Computation) -> OperationView:
    return OperationView(
        id=computation.requested.operation_id,
        verb=computation.requested.verb,
        case_id=computation.case_id,
        plan=None,
        hold_to_move=False,
        status=status_name(computation),
        progress=ProgressView.of(progress_of_computation(computation)),
        ended_by=None if computation.ended else "cancel",
        began=computation.step > 1,
        code=computation.code,
        detail=computation.message or computation.requested.says,
        result=computation.result,
        deviation_mm=None,
        deviation_deg=None,
        requested_at_ns=computation.requested_at_ns,
        ended_at_ns=computation.ended_at_ns,
        approver=None,
        authenticated_by=None,
        permit_sha256=None,
    )


def _of_localising(localising: Localising) -> OperationView:
    return OperationView(
        id=localising.operation_id,
        verb=VERB,
        case_id=localising.case_id,
        plan=None,
        hold_to_move=False,
        status=status_name(localising),
        progress=ProgressView.of(progress_of_localising(localising)),
        ended_by=None,
        began=True,
        code=localising.code,
        detail=localising.message,
        result=localising.result,
        deviation_mm=None,
        deviation_deg=None,
        requested_at_ns=localising.requested_at_ns,
        ended_at_ns=localising.ended_at_ns,
        approver=None,
        authenticated_by=None,
        permit_sha256=None,
    )


def status_name(operation: AnyOperation) -> OperationStatusName:
    """How far an operation has come, as clients see it."""
    return _STATUS_NAMES[operation.status] if isinstance(operation, Operation) else operation.status.value


class LeaseView(View):
    """A renewed hold-to-move lease."""

    operation: str
    expires_in_s: float
