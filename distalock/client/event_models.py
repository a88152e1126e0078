"""What each kind of event carries.

Written by `make generated` from `docs/asyncapi.json`; do not edit.
"""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from distalock.client.base import ReceivedModel

AccountChange = Literal[
    "created",
    "roles_changed",
    "password_changed",
    "disabled",
    "enabled",
    "passkey_added",
    "passkey_removed",
    "sessions_ended",
    "refresh_token_reused",
]


class AccountChanged(ReceivedModel):
    """An account was changed. `roles` are those from now on."""

    user_name: str
    change: AccountChange
    roles: tuple[str, ...]


class ApprovalWithdrawn(ReceivedModel):
    """A surgeon took an approval back before any motion began from it."""

    number: int
    plan_sha256: str


class RefusedOnBus(ReceivedModel):
    """What one sender tried in one way on one key; `service` is its certificate's name, empty without a link."""

    code: str
    service: str
    what: str
    key: str
    times: int
    last_at_ns: int


class BusRefused(ReceivedModel):
    """The router refused links or messages: those that were not on record yet, each with how often until now.

    Attributes
    ----------
    router_epoch
        A run of the router.
    messages_denied, links_refused, unknown_names
        In this run until now, also those that are not named here.
    gaps
        How often in this run refusals came faster than they could be counted.
    """

    router_epoch: str
    messages_denied: int
    links_refused: int
    unknown_names: int
    gaps: int
    refusals: tuple[RefusedOnBus, ...]


class PartUse(ReceivedModel):
    """A part file in use: its name in the catalogue (or `inline`) and the hash of its JSON text.

    Attributes
    ----------
    hole_ids
        Of a guide and a nail.
    bone
        That a nail is made for; empty where its file does not say.
    """

    name: str
    sha256: str
    hole_ids: tuple[str, ...] = Field(default=())
    bone: str = Field(default="")


class CaseSetup(ReceivedModel):
    """The patient set-up of a case."""

    side: str
    bone: str
    mount: str
    head_extension_mm: float
    ring: PartUse
    guide: PartUse
    nail: PartUse
    hexapod: PartUse
    guide_calibrated: bool = Field(default=False)
    nominal_source_to_detector_mm: float | None = Field(default=None)
    nominal_pixel_mm: float | None = Field(default=None)
    drill_diameter_mm: float = Field(default=4.0)


class CaseOpened(ReceivedModel):
    """A case was opened."""

    setup: CaseSetup


class ImageNumbers(ReceivedModel):
    """Numbers of images in one image store, as ranges from the first to the last."""

    store_id: str
    ranges: tuple[tuple[int, int], ...]


class CasePruned(ReceivedModel):
    """A closed case was removed by rule: the content of its events, documents that no other event names, its images.

    Attributes
    ----------
    event_ranges
        Numbers of the events that are empty now, as ranges from the first to the last.
    documents, images
        Hashes of what was deleted.
    image_numbers
        Numbers of its images, which are on record all the same.
    """

    pruned_case_id: str
    rule: str
    event_ranges: tuple[tuple[int, int], ...]
    documents: tuple[str, ...]
    images: tuple[str, ...]
    image_numbers: tuple[ImageNumbers, ...] = Field(default=())


ComputationStatus = Literal["running", "succeeded", "failed", "cancelled"]


class ComputationEnded(ReceivedModel):
    """A computation is over: `result` is the path of what it made; a cancelled one has made nothing."""

    operation_id: str
    status: ComputationStatus
    code: str
    message: str
    result: str | None = Field(default=None)


class ComputationProgressed(ReceivedModel):
    """A computation is at another of its steps, which `says` names."""

    operation_id: str
    step: int
    says: str


class ComputationRequested(ReceivedModel):
    """A verification, a quality report or a plan is computed while nobody waits for it. `says` is what, in words."""

    operation_id: str
    verb: Literal["verify", "report_quality", "plan"]
    says: str


class GatewayStarted(ReceivedModel):
    """The gateway began to run."""

    boot_epoch: str
    version: str


class ImageCalibrated(ReceivedModel):
    """An image's calibration, or why it has none."""

    image_sha256: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str


class ImageReceived(ReceivedModel):
    """The C-arm delivered an image. `header_sha256` names its header's document (None: only its name is known).

    `sequence` is its number in the image store `store_id`; records of older versions have neither. `in_run`: it is a
    frame of running fluoroscopy, of which not every one is calibrated and localised. `laterality`: the side that
    its file states, None where it states none.
    """

    image_sha256: str
    sop_instance_uid: str
    received_at_ns: int
    case_revision: int
    header_sha256: str | None
    store_id: str | None = Field(default=None)
    sequence: int | None = Field(default=None)
    in_run: bool = Field(default=False)
    laterality: str | None = Field(default=None)


class ImageSkipped(ReceivedModel):
    """A step was left out for an image, `calibration` or `localisation`, and why."""

    image_sha256: str
    step: str
    code: str
    message: str


class ImagesPruned(ReceivedModel):
    """Files of images were deleted by rule; the events that name these images stay."""

    rule: str
    images: tuple[str, ...]


class LocalisationReceived(ReceivedModel):
    """Registration's answer to an image."""

    number: int
    image_sha256: str
    case_revision: int
    registration_epoch: str
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str
    overlay_sha256: str | None


OperationStatus = Literal["requested", "running", "unknown", "succeeded", "failed", "stopped"]


class OperationEnded(ReceivedModel):
    """The operation is over. `began` is False only when the robot certainly never carried it out."""

    operation_id: str
    status: OperationStatus
    began: bool
    code: str
    message: str
    deviation_mm: float | None = Field(default=None)
    deviation_deg: float | None = Field(default=None)


class OperationProgressed(ReceivedModel):
    """The robot began, or did not answer (`unknown`)."""

    operation_id: str
    status: OperationStatus
    message: str


class OperationRequested(ReceivedModel):
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
    verb: Literal["move", "reference", "acknowledge_stop", "reset"]
    plan_number: int | None
    plan_sha256: str | None
    hold_to_move: bool
    robot_boot_epoch: str
    after_state_sequence: int
    state_sent_at_ns: int
    previous_command_id: str | None
    time_to_live_s: float
    state_clock_s: float | None = Field(default=None)
    approver: str | None = Field(default=None)
    permit_sha256: str | None = Field(default=None)
    permit_signature: str | None = Field(default=None)
    permit_key_sha256: str | None = Field(default=None)
    authenticated_by: str | None = Field(default=None)


class PlanApproved(ReceivedModel):
    """A surgeon's consent to exactly one plan; `authenticated_by` is how he showed who he is, None in old records."""

    number: int
    plan_sha256: str
    approved_by: str
    approved_at_ns: int
    authenticated_by: str | None = Field(default=None)


class PlanMade(ReceivedModel):
    """A plan, ready for approval."""

    number: int
    localisation: int
    hole_ids: tuple[str, ...]
    plan_sha256: str
    image_sha256: str
    case_revision: int


class PlanRefused(ReceivedModel):
    """Registration made no plan."""

    localisation: int
    hole_ids: tuple[str, ...]
    code: str
    message: str


class PresenceChanged(ReceivedModel):
    """A service appeared or vanished."""

    service: str
    alive: bool


class QaReported(ReceivedModel):
    """Imaging's quality report over images of a case, and its page for people."""

    number: int
    images: tuple[str, ...]
    verdict: str
    document_sha256: str
    page_sha256: str


class RobotChanged(ReceivedModel):
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
    permit_sha256: str | None = Field(default=None)
    permits_refused: int = Field(default=0)
    permit_refusal: str = Field(default="")


class SetupChanged(ReceivedModel):
    """The set-up changed; everything measured under an older revision is stale."""

    revision: int
    setup: CaseSetup


Step = Literal[
    "wires_inserted",
    "wires_removed",
    "drill_inserted",
    "drill_removed",
    "drilled",
    "screws_inserted",
    "screws_removed",
    "mount_moved",
    "ring_remounted",
    "robot_removed",
    "finished",
    "abandoned",
]


class StepRecorded(ReceivedModel):
    """What people did with their hands. `out_of_order` steps carry the reason that was given for them."""

    step: Step
    hole_ids: tuple[str, ...]
    out_of_order: bool
    why: str


class StepWithdrawn(ReceivedModel):
    """A step that was recorded by mistake is taken back: it was not done."""

    number: int
    step: Step


class StopRequested(ReceivedModel):
    """Stop was sent to the robot."""

    reason: str
    confirmed: bool
    message: str


class VerificationMade(ReceivedModel):
    """Wires or guide holes compared with the nail's hole axes.

    `passing_hole_ids` are those through which a drill would pass; None in records of older versions.
    """

    number: int
    images: tuple[str, ...]
    verdict: str
    reason_codes: tuple[str, ...]
    document_sha256: str
    passing_hole_ids: tuple[str, ...] | None = Field(default=None)


class VerificationRefused(ReceivedModel):
    """There is no verification: registration could not make one, or the guide may have moved meanwhile."""

    images: tuple[str, ...]
    code: str
    message: str


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

DATA_OF_KIND: Mapping[str, type[EventData]] = {
    "gateway_started": GatewayStarted,
    "case_opened": CaseOpened,
    "setup_changed": SetupChanged,
    "image_received": ImageReceived,
    "image_calibrated": ImageCalibrated,
    "image_skipped": ImageSkipped,
    "localisation_received": LocalisationReceived,
    "plan_made": PlanMade,
    "plan_refused": PlanRefused,
    "plan_approved": PlanApproved,
    "approval_withdrawn": ApprovalWithdrawn,
    "operation_requested": OperationRequested,
    "operation_progressed": OperationProgressed,
    "operation_ended": OperationEnded,
    "computation_requested": ComputationRequested,
    "computation_progressed": ComputationProgressed,
    "computation_ended": ComputationEnded,
    "stop_requested": StopRequested,
    "verification_made": VerificationMade,
    "verification_refused": VerificationRefused,
    "qa_reported": QaReported,
    "step_recorded": StepRecorded,
    "step_withdrawn": StepWithdrawn,
    "robot_changed": RobotChanged,
    "presence_changed": PresenceChanged,
    "bus_refused": BusRefused,
    "case_pruned": CasePruned,
    "images_pruned": ImagesPruned,
    "account_changed": AccountChanged,
}
