"""The events of the case record: their kinds, and their place in the log.

The event log is the only truth about a case: everything else (`core.case`, `core.procedure`) is derived from it.
"""

from dataclasses import dataclass
from enum import StrEnum

from services.ui_api.core.account_event_data import AccountChanged
from services.ui_api.core.bus_event_data import BusRefused
from services.ui_api.core.computation_event_data import (
    ComputationEnded,
    ComputationProgressed,
    ComputationRequested,
)
from services.ui_api.core.event_data import (
    ApprovalWithdrawn,
    CaseOpened,
    CasePruned,
    GatewayStarted,
    ImageCalibrated,
    ImageReceived,
    ImageSkipped,
    ImagesPruned,
    LocalisationReceived,
    PlanApproved,
    PlanMade,
    PlanRefused,
    PresenceChanged,
    QaReported,
    SetupChanged,
    StepRecorded,
    StepWithdrawn,
    VerificationMade,
    VerificationRefused,
)
from services.ui_api.core.robot_event_data import (
    OperationEnded,
    OperationProgressed,
    OperationRequested,
    RobotChanged,
    StopRequested,
)


class EventKind(StrEnum):
    """Name of an event's kind, as it stands in the log and on the event stream."""

    GATEWAY_STARTED = "gateway_started"
    CASE_OPENED = "case_opened"
    SETUP_CHANGED = "setup_changed"
    IMAGE_RECEIVED = "image_received"
    IMAGE_CALIBRATED = "image_calibrated"
    IMAGE_SKIPPED = "image_skipped"
    LOCALISATION_RECEIVED = "localisation_received"
    PLAN_MADE = "plan_made"
    PLAN_REFUSED = "plan_refused"
    PLAN_APPROVED = "plan_approved"
    APPROVAL_WITHDRAWN = "approval_withdrawn"
    OPERATION_REQUESTED = "operation_requested"
    OPERATION_PROGRESSED = "operation_progressed"
    OPERATION_ENDED = "operation_ended"
    COMPUTATION_REQUESTED = "computation_requested"
    COMPUTATION_PROGRESSED = "computation_progressed"
    COMPUTATION_ENDED = "computation_ended"
    STOP_REQUESTED = "stop_requested"
    VERIFICATION_MADE = "verification_made"
    VERIFICATION_REFUSED = "verification_refused"
    QA_REPORTED = "qa_reported"
    STEP_RECORDED = "step_recorded"
    STEP_WITHDRAWN = "step_withdrawn"
    ROBOT_CHANGED = "robot_changed"
    PRESENCE_CHANGED = "presence_changed"
    BUS_REFUSED = "bus_refused"
    CASE_PRUNED = "case_pruned"
    IMAGES_PRUNED = "images_pruned"
    ACCOUNT_CHANGED = "account_changed"


EventData = (
    GatewayStarted
    | CaseOpened
    | SetupChanged
    | ImageReceived
    | ImageCalibrated
    | ImageSkipped
    | LocalisationReceived
    | PlanMade
    | PlanRefused
    | PlanApproved
    | ApprovalWithdrawn
    | OperationRequested
    | OperationProgressed
    | OperationEnded
    | ComputationRequested
    | ComputationProgressed
    | ComputationEnded
    | StopRequested
    | VerificationMade
    | VerificationRefused
    | QaReported
    | StepRecorded
    | StepWithdrawn
    | RobotChanged
    | PresenceChanged
    | BusRefused
    | CasePruned
    | ImagesPruned
    | AccountChanged
)

DATA_OF_KIND: dict[EventKind, type[EventData]] = {
    EventKind.GATEWAY_STARTED: GatewayStarted,
    EventKind.CASE_OPENED: CaseOpened,
    EventKind.SETUP_CHANGED: SetupChanged,
    EventKind.IMAGE_RECEIVED: ImageReceived,
    EventKind.IMAGE_CALIBRATED: ImageCalibrated,
    EventKind.IMAGE_SKIPPED: ImageSkipped,
    EventKind.LOCALISATION_RECEIVED: LocalisationReceived,
    EventKind.PLAN_MADE: PlanMade,
    EventKind.PLAN_REFUSED: PlanRefused,
    EventKind.PLAN_APPROVED: PlanApproved,
    EventKind.APPROVAL_WITHDRAWN: ApprovalWithdrawn,
    EventKind.OPERATION_REQUESTED: OperationRequested,
    EventKind.OPERATION_PROGRESSED: OperationProgressed,
    EventKind.OPERATION_ENDED: OperationEnded,
    EventKind.COMPUTATION_REQUESTED: ComputationRequested,
    EventKind.COMPUTATION_PROGRESSED: ComputationProgressed,
    EventKind.COMPUTATION_ENDED: ComputationEnded,
    EventKind.STOP_REQUESTED: StopRequested,
    EventKind.VERIFICATION_MADE: VerificationMade,
    EventKind.VERIFICATION_REFUSED: VerificationRefused,
    EventKind.QA_REPORTED: QaReported,
    EventKind.STEP_RECORDED: StepRecorded,
    EventKind.STEP_WITHDRAWN: StepWithdrawn,
    EventKind.ROBOT_CHANGED: RobotChanged,
    EventKind.PRESENCE_CHANGED: PresenceChanged,
    EventKind.BUS_REFUSED: BusRefused,
    EventKind.CASE_PRUNED: CasePruned,
    EventKind.IMAGES_PRUNED: ImagesPruned,
    EventKind.ACCOUNT_CHANGED: AccountChanged,
}

KIND_OF_DATA: dict[type[EventData], EventKind] = {data: kind for kind, data in DATA_OF_KIND.items()}


@dataclass(frozen=True, slots=True)
class EventDraft:
    """An event before it has a place in the log."""

    data: EventData
    case_id: str | None
    who: str
    why: str = ""


@dataclass(frozen=True, slots=True)
class Event:
    """An event in the log: who, when, what and why."""

    sequence: int
    at_ns: int
    case_id: str | None
    who: str
    why: str
    data: EventData

    @property
    def kind(self) -> EventKind:
        """Kind of the event, from its data."""
        return KIND_OF_DATA[type(self.data)]
