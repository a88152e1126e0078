"""How far operations have come: of a move that is under way, by where the robot stands on its way now."""

from typing import Final

from services.ui_api.core.operations import Operation
from services.ui_api.core.progress import Progress, progress_of_operation, share_of_way
from services.ui_api.core.robot_event_data import OperationStatus
from services.ui_api.handlers.robot_view import RobotView, Validity
from services.ui_api.record.record import CaseRecord
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import decode
from shared.messages.registration import Plan

# Chosen: one move is under way at a time; those before it are asked for no more.
_WAYS_HELD: Final = 4


class OperationProgress:
    """Reads the way of a move from its plan, once."""

    def __init__(self, record: CaseRecord, view: RobotView) -> None:
        self._record, self._view = record, view
        self._ways: dict[str, tuple[PlatformPose, PlatformPose]] = {}

    def of(self, operation: Operation) -> Progress:
        """How far a command to the robot has come."""
        return progress_of_operation(operation, self._share(operation))

    def _share(self, operation: Operation) -> float | None:
        plan_sha256, seen = operation.requested.plan_sha256, self._view.newest()
        if plan_sha256 is None or operation.status is not OperationStatus.RUNNING or seen is None:
            return None
        pose = seen.state.pose
        if pose is None or self._view.validity() is not Validity.CURRENT:
            return None
        return share_of_way(*self._way(plan_sha256), pose.value())

    def _way(self, plan_sha256: str) -> tuple[PlatformPose, PlatformPose]:
        known = self._ways.get(plan_sha256)
        if known is None:
            plan = decode(Plan, self._record.document(plan_sha256))
            known = plan.start_pose.value(), plan.target_pose.value()
            self._ways = {**dict(list(self._ways.items())[1 - _WAYS_HELD :]), plan_sha256: known}
        return known
