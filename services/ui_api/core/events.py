"""What the case record remembers: one frozen dataclass per kind of event.

The event log is the only truth about a case: everything else (`core.case`, `core.procedure`) is derived from it.
Fields are plain values, so that an event's JSON can be hashed and read by people for ever; what is large (part files,
localisations, overlays) lies beside the log as documents, named by their SHA-256.
"""

from dataclasses import dataclass
from enum import StrEnum


class EventKind(StrEnum):
    """Name of an event's kind, as it stands in the log and on the event stream."""

    GATEWAY_STARTED = "gateway_started"
    CASE_OPENED = "case_opened"
    SETUP_CHANGED = "setup_changed"
    IMAGE_RECEIVED = "image_received"
    IMAGE_CALIBRATED = "image_calibrated"
    LOCALISATION_RECEIVED = "localisation_received"
    PLAN_MADE = "plan_made"
    PLAN_REFUSED = "plan_refused"
    PLAN_APPROVED = "plan_approved"
    OPERATION_REQUESTED = "operation_requested"
    OPERATION_PROGRESSED = "operation_progressed"
    OPERATION_ENDED = "operation_ended"
    STOP_REQUESTED = "stop_requested"
    VERIFICATION_MADE = "verification_made"
    VERIFICATION_REFUSED = "verification_refused"
    STEP_RECORDED = "step_recorded"
    ROBOT_CHANGED = "robot_changed"
    PRESENCE_CHANGED = "presence_changed"


class Step(StrEnum):
    """What people did with their hands."""

    WIRES_INSERTED = "wires_inserted"
    WIRES_REMOVED = "wires_removed"
    DRILLED = "drilled"
    SCREWS_INSERTED = "screws_inserted"
    MOUNT_MOVED = "mount_moved"
    RING_REMOUNTED = "ring_remounted"
    ROBOT_REMOVED = "robot_removed"
    FINISHED = "finished"
    ABANDONED = "abandoned"


class OperationStatus(StrEnum):
    """How far a command to the robot has come."""

    REQUESTED = "requested"
    RUNNING = "running"
    UNKNOWN = "unknown"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class PartUse:
    """A part file in use: its name in the catalogue (or `inline`), the hash of its JSON text, its hole ids."""

    name: str
    sha256: str
    hole_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CaseSetup:
    """The patient set-up of a case."""

    side: str
    bone: str
    mount: str
    head_extension_mm: float
    ring: PartUse
    guide: PartUse
    nail: PartUse
    hexapod: PartUse
    guide_calibrated: bool = False
    nominal_source_to_detector_mm: float | None = None
    nominal_pixel_mm: float | None = None


@dataclass(frozen=True, slots=True)
class GatewayStarted:
    """The gateway began to run."""

    boot_epoch: str
    version: str


@dataclass(frozen=True, slots=True)
class CaseOpened:
    """A case was opened."""

    setup: CaseSetup


@dataclass(frozen=True, slots=True)
class SetupChanged:
    """The set-up changed; everything measured under an older revision is stale."""

    revision: int
    setup: CaseSetup


@dataclass(frozen=True, slots=True)
class ImageReceived:
    """The C-arm delivered an image. `header_sha256` names its header's document (None: only its name is known)."""

    image_sha256: str
    sop_instance_uid: str
    received_at_ns: int
    case_revision: int
    header_sha256: str | None


@dataclass(frozen=True, slots=True)
class ImageCalibrated:
    """An image's calibration, or why it has none."""

    image_sha256: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str


@dataclass(frozen=True, slots=True)
class LocalisationReceived:
    """Registration's answer to an image."""

    number: int
    image_sha256: str
    case_revision: int
    registration_epoch: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str
    overlay_sha256: str | None


@dataclass(frozen=True, slots=True)
class PlanMade:
    """A plan, ready for approval."""

    number: int
    localisation: int
    hole_ids: tuple[str, ...]
    plan_sha256: str
    image_sha256: str
    case_revision: int


@dataclass(frozen=True, slots=True)
class PlanRefused:
    """Registration made no plan."""

    localisation: int
    hole_ids: tuple[str, ...]
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class PlanApproved:
    """A surgeon's consent to exactly one plan."""

    number: int
    plan_sha256: str
    approved_by: str
    approved_at_ns: int


@dataclass(frozen=True, slots=True)
class OperationRequested:
    """A command is about to be sent to the robot. Recorded before it is sent: it is never sent twice.

    Attributes
    ----------
    operation_id
        Also the command's id.
    verb
        `move`, `reference`, `acknowledge_stop` or `reset`.
    plan_number, plan_sha256
        Of a move; None otherwise.
    hold_to_move
        Whether motion lasts only as long as a lease is renewed.
    robot_boot_epoch, after_state_sequence, state_sent_at_ns, previous_command_id
        From the newest robot state before sending: what decides, later, whether the command can still take effect.
    time_to_live_s
        How long after that state the robot may begin.
    """

    operation_id: str
    verb: str
    plan_number: int | None
    plan_sha256: str | None
    hold_to_move: bool
    robot_boot_epoch: str
    after_state_sequence: int
    state_sent_at_ns: int
    previous_command_id: str | None
    time_to_live_s: float


@dataclass(frozen=True, slots=True)
class OperationProgressed:
    """The robot began, or did not answer (`unknown`)."""

    operation_id: str
    status: OperationStatus
    message: str


@dataclass(frozen=True, slots=True)
class OperationEnded:
    """The operation is over. `began` is False when the robot certainly never carried it out."""

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
class VerificationMade:
    """Wires or guide holes compared with the nail's hole axes."""

    number: int
    images: tuple[str, ...]
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str


@dataclass(frozen=True, slots=True)
class VerificationRefused:
    """Registration could not verify."""

    images: tuple[str, ...]
    code: str
    message: str


@dataclass(frozen=True, slots=True)
class StepRecorded:
    """What people did with their hands. `out_of_order` steps carry the reason that was given for them."""

    step: Step
    hole_ids: tuple[str, ...]
    out_of_order: bool
    why: str


@dataclass(frozen=True, slots=True)
class RobotChanged:
    """The robot's condition changed (its pose alone makes no event)."""

    boot_epoch: str
    state: str
    stop: str
    locked: bool
    referenced: bool
    command_id: str | None
    outcome: str
    detail: str
    controller_identity: str


@dataclass(frozen=True, slots=True)
class PresenceChanged:
    """A service appeared or vanished."""

    service: str
    alive: bool


EventData = (
    GatewayStarted
    | CaseOpened
    | SetupChanged
    | ImageReceived
    | ImageCalibrated
    | LocalisationReceived
    | PlanMade
    | PlanRefused
    | PlanApproved
    | OperationRequested
    | OperationProgressed
    | OperationEnded
    | StopRequested
    | VerificationMade
    | VerificationRefused
    | StepRecorded
    | RobotChanged
    | PresenceChanged
)

DATA_OF_KIND: dict[EventKind, type[EventData]] = {
    EventKind.GATEWAY_STARTED: GatewayStarted,
    EventKind.CASE_OPENED: CaseOpened,
    EventKind.SETUP_CHANGED: SetupChanged,
    EventKind.IMAGE_RECEIVED: ImageReceived,
    EventKind.IMAGE_CALIBRATED: ImageCalibrated,
    EventKind.LOCALISATION_RECEIVED: LocalisationReceived,
    EventKind.PLAN_MADE: PlanMade,
    EventKind.PLAN_REFUSED: PlanRefused,
    EventKind.PLAN_APPROVED: PlanApproved,
    EventKind.OPERATION_REQUESTED: OperationRequested,
    EventKind.OPERATION_PROGRESSED: OperationProgressed,
    EventKind.OPERATION_ENDED: OperationEnded,
    EventKind.STOP_REQUESTED: StopRequested,
    EventKind.VERIFICATION_MADE: VerificationMade,
    EventKind.VERIFICATION_REFUSED: VerificationRefused,
    EventKind.STEP_RECORDED: StepRecorded,
    EventKind.ROBOT_CHANGED: RobotChanged,
    EventKind.PRESENCE_CHANGED: PresenceChanged,
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
