"""Commands to the robot as operations: what a robot state says about one that is under way.

A command that brought no answer is `unknown`, never "not executed": the robot may still have begun. Only the robot's
own state settles it: by its boot epoch, its sequence numbers, the commands it names, and its monotonic clock, which is
compared with nothing but itself. Wall clocks settle nothing: they may be set while a command is under way.
"""

from dataclasses import dataclass, replace

from services.ui_api.core.robot_event_data import (
    OperationEnded,
    OperationProgressed,
    OperationRequested,
    OperationStatus,
)

VERBS_WITH_A_MOTION = frozenset({"move", "reference"})
ENDED = frozenset({OperationStatus.SUCCEEDED, OperationStatus.FAILED, OperationStatus.STOPPED})

_SETTLING_S = 1.0
_STATUS_OF_OUTCOME = {
    "reached": OperationStatus.SUCCEEDED,
    "stopped": OperationStatus.STOPPED,
    "failed": OperationStatus.FAILED,
}


@dataclass(frozen=True, slots=True)
class Operation:
    """A command to the robot and how far it has come."""

    requested: OperationRequested
    case_id: str | None
    requested_at_ns: int
    status: OperationStatus = OperationStatus.REQUESTED
    began: bool | None = None
    code: str = ""
    message: str = ""
    deviation_mm: float | None = None
    deviation_deg: float | None = None
    ended_at_ns: int | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more will come of it."""
        return self.status in ENDED


@dataclass(frozen=True, slots=True)
class RobotSaying:
    """The part of a robot state that tells how a command fared.

    Attributes
    ----------
    connected
        Whether the controller is connected: it was stopped and locked then. Before, what an earlier run of the service
        began may still go on.
    """

    boot_epoch: str
    sequence: int
    clock_s: float | None
    command_id: str | None
    outcome: str
    at_rest: bool
    stop_latched: bool
    in_fault: bool
    detail: str
    deviation_mm: float | None
    deviation_deg: float | None
    connected: bool = True


def progressed(operation: Operation, event: OperationProgressed) -> Operation:
    """The operation after an `OperationProgressed`."""
    began = True if event.status is OperationStatus.RUNNING else operation.began
    return replace(operation, status=event.status, message=event.message, began=began)


def ended(operation: Operation, event: OperationEnded, at_ns: int) -> Operation:
    """The operation after an `OperationEnded`."""
    return replace(
        operation,
        status=event.status,
        began=event.began,
        code=event.code,
        message=event.message,
        deviation_mm=event.deviation_mm,
        deviation_deg=event.deviation_deg,
        ended_at_ns=at_ns,
    )


def settle(operation: Operation, saying: RobotSaying) -> OperationProgressed | OperationEnded | None:
    """What a robot state says about an operation; None when it says nothing new.

    Parameters
    ----------
    operation
        An operation that has not ended.
    saying
        The robot's newest state.
    """
    requested = operation.requested
    if saying.boot_epoch != requested.robot_boot_epoch:
        return _robot_restarted(operation) if saying.connected else None
    if saying.sequence <= requested.after_state_sequence:
        return None
    if saying.command_id == requested.operation_id:
        return _own_command(operation, saying)
    if requested.verb not in VERBS_WITH_A_MOTION:
        return _by_its_effect(operation, saying) if _too_late(operation, saying) else None
    if saying.command_id != requested.previous_command_id:
        return _overtaken(operation, saying)
    begun = operation.status is OperationStatus.RUNNING
    return None if begun or not _too_late(operation, saying) else _not_executed(operation)


def _too_late(operation: Operation, saying: RobotSaying) -> bool:
    """Whether the robot refuses the command from now on, with some time on top for a command being decided on."""
    requested = operation.requested
    if requested.state_clock_s is None or saying.clock_s is None:
        return False
    return saying.clock_s - requested.state_clock_s > requested.time_to_live_s + _SETTLING_S


def _not_executed(operation: Operation) -> OperationEnded:
    requested = operation.requested
    return OperationEnded(
        requested.operation_id,
        OperationStatus.FAILED,
        began=False,
        code="not_executed",
        message=f"the robot did not begin the command within its {requested.time_to_live_s:g} s and refuses it from "
        "now on; nothing moved",
    )


def _overtaken(operation: Operation, saying: RobotSaying) -> OperationEnded:
    return OperationEnded(
        operation.requested.operation_id,
        OperationStatus.FAILED,
        began=True,
        code="outcome_not_seen",
        message=f"the robot has gone on to command {saying.command_id}, and how this one ended was not seen; take a "
        "new image before the next plan",
    )


def _by_its_effect(operation: Operation, saying: RobotSaying) -> OperationEnded:
    """Commands without a motion leave no trace but their effect; another stop or fault may have come since."""
    waits_for = saying.stop_latched if operation.requested.verb == "acknowledge_stop" else saying.in_fault
    condition = "its stop" if operation.requested.verb == "acknowledge_stop" else "its fault"
    return OperationEnded(
        operation.requested.operation_id,
        OperationStatus.FAILED if waits_for else OperationStatus.SUCCEEDED,
        began=True,
        code="no_effect" if waits_for else "",
        message=f"the robot gave no answer; {condition} is {'still' if waits_for else 'no longer'} in force",
    )


def _own_command(operation: Operation, saying: RobotSaying) -> OperationProgressed | OperationEnded | None:
    operation_id = operation.requested.operation_id
    status = _STATUS_OF_OUTCOME.get(saying.outcome)
    if status is None:
        if operation.status is OperationStatus.RUNNING or saying.at_rest:
            return None
        return OperationProgressed(operation_id, OperationStatus.RUNNING, saying.detail)
    if not saying.at_rest:
        return None  # the outcome counts once the robot is braked again
    return OperationEnded(
        operation_id,
        status,
        began=True,
        code="" if status is OperationStatus.SUCCEEDED else f"motion_{saying.outcome}",
        message=saying.detail,
        deviation_mm=saying.deviation_mm,
        deviation_deg=saying.deviation_deg,
    )


def _robot_restarted(operation: Operation) -> OperationEnded:
    return OperationEnded(
        operation.requested.operation_id,
        OperationStatus.FAILED,
        began=operation.began is not False,
        code="robot_restarted",
        message="the robot service restarted before it reported an outcome: the command will not go on, but how far "
        "it got is not known; take a new image before the next plan",
    )
