"""What the gateway takes and answers, one model for each schema of its interface.

Written by `make generated` from `docs/openapi.json`; do not edit.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Literal

from pydantic import Field

from distalock.client.base import ReceivedModel, SentModel


class ActionView(ReceivedModel):
    """An action or a step: who may take it, whether it may be taken now, and if not, why and what to do."""

    name: str
    verdict: Literal["allowed", "with_reason", "refused"] = Field(
        description="`with_reason`: a step out of order, that can be recorded with `why`."
    )
    roles: tuple[str, ...] = Field(description="Who may.")
    code: str = Field(description="The code that a request would be refused with; empty when it is allowed.")
    reason: str
    remedy: str
    refused_by: Literal["gateway", "robot"] | None = Field(
        description="What the robot refuses is sent to it all the same, and its operation fails."
    )


class AdvisedScrew(ReceivedModel):
    """The axis of one screw of the mount, for the jig; pixels are those of the un-mirrored image."""

    id: Literal["distal", "proximal"]
    proximal_mm: float = Field(description="From the middle between the nail's holes, along the nail.")
    outside_px: tuple[float, float] = Field(description="A point of the axis towards the surgeon.")
    at_nail_px: tuple[float, float] = Field(
        description="Where the axis would meet the nail; the screw ends in the near cortex."
    )
    tilt_to_ray_deg: float = Field(description="Between the axis and the X-ray to it.")
    shown: bool = Field(description="Whether the image shows this place.")


Priority = Literal["high", "medium", "low"]


class AlarmView(ReceivedModel):
    """One alarm: how urgent it is, what holds, what was measured, and what to do."""

    code: str
    priority: Priority
    means: str
    measured: str
    remedy: str


class AlarmsView(ReceivedModel):
    """All alarms, the most urgent first; none is the normal state."""

    highest: Priority | None
    items: tuple[AlarmView, ...]


class CArmCorrection(ReceivedModel):
    """How to turn source and detector together, about the camera frame's axes, right-handed."""

    about_image_x: float
    about_image_y: float


class GuidanceUncertainty(ReceivedModel):
    """Standard deviation of every tilt and of the correction, in degrees: the holes are in one piece of metal."""

    about_image_x: float
    about_image_y: float


class GuidedHole(ReceivedModel):
    """Tilt of one hole's axis against the ray through it, in degrees.

    `about_image_x` and `about_image_y` turn the ray to the axis, about the camera frame's axes, right-handed.
    """

    id: str
    tilt_to_ray_deg: float
    about_image_x: float
    about_image_y: float


class ImageReference(ReceivedModel):
    """Which image a result was measured in."""

    sha256: str
    sop_instance_uid: str
    sequence: int = Field(
        description="Number in the image store, which gives one to every image: from 1, without a gap, over all restarts."
    )
    received_at_ns: int = Field(description="For people: never compared.")
    run_interval_s: float | None = Field(
        default=None,
        description="Present when the image is part of a run of images (running fluoroscopy): it was received within this time after the image before it, in seconds. The run ends when no image follows within this time. The first image of a run has none, and neither has a single shot.",
    )
    store_id: str | None = Field(
        default=None,
        description="Names the image store in which `sequence` counts. Images of two stores have no order.",
    )


class MirrorCheck(ReceivedModel):
    """Confidence in the tilt's sign, and in which frame, counted back from this one, it was measured.

    `log_likelihood_ratio` is None where the frame has no second optimum, as near zero tilt.
    """

    log_likelihood_ratio: float | None
    frames_ago: int


class OffCentre(ReceivedModel):
    """How far the holes' middle lies off the picture's, un-mirrored, in mm at their depth: move the C-arm so."""

    to_image_right: float
    to_image_down: float


class PositionerShift(ReceivedModel):
    """Shift of the C-arm that centres the holes, for a patient on the back: along the table, across it, up; in mm."""

    towards_head: float
    to_patients_right: float
    up: float


class PositionerTurn(ReceivedModel):
    """The correction in the C-arm's own angles: how far to turn each, and where they are then, in degrees."""

    orbital: float
    angular: float
    orbital_then: float
    angular_then: float


ReasonCode = Literal[
    "image_unusable",
    "saturated",
    "motion_blur",
    "ring_not_found",
    "ring_ambiguous",
    "ring_too_few_balls",
    "calibration_extrapolated",
    "guide_not_found",
    "guide_ambiguous",
    "guide_too_few_balls",
    "guide_model_mismatch",
    "nail_not_found",
    "hole_not_visible",
    "nail_model_mismatch",
    "mirror_ambiguous",
    "uncertainty_too_large",
    "tilt_too_large",
    "wire_not_found",
    "images_disagree",
    "image_processed",
]


class ReasonMessage(ReceivedModel):
    """A reason for a refusal."""

    code: ReasonCode
    message: str


class ViewAssessment(ReceivedModel):
    """How well the C-arm looks along the holes: `too_far` is refused, and of a `good` view no better one is needed.

    Attributes
    ----------
    saved_by_a_degree
        Share of the axis's error that one degree less tilt would take away, from the accuracy benchmark.
    """

    quality: Literal["good", "usable", "too_far"]
    largest_tilt_deg: float
    saved_by_a_degree: float


class GuidanceView(ReceivedModel):
    """What the newest frame of running fluoroscopy said, with its age and whether it is about the moment.

    It is current while its frame is the newest image. While newer ones are on their way it is current for half a second
    after it was heard, and only if the frame itself is no older than a second. `age_s` is the frame's, on monotonic
    clocks; null when nobody knows.
    """

    schema_name: Literal["distalock/guidance/1"] = Field(default="distalock/guidance/1", alias="schema")
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[ReasonMessage, ...]
    origin: Literal["localised", "followed"]
    image: ImageReference
    case_id: str | None
    case_revision: int
    holes: tuple[GuidedHole, ...] | None
    c_arm_correction_deg: CArmCorrection | None
    positioner_turn_deg: PositionerTurn | None
    standard_uncertainty_deg: GuidanceUncertainty | None
    mirror_check: MirrorCheck | None
    skipped: int
    elapsed_ms: float
    image_age_s: float | None = Field(
        default=None,
        description="Age of the image when this message was published, in seconds on monotonic clocks: what imaging stated, and the time since then. None: not known, because imaging or registration has started anew since the image was received.",
    )
    assessment: ViewAssessment | None = Field(default=None, description="How well the C-arm looks along the holes.")
    off_centre_mm: OffCentre | None = Field(default=None)
    positioner_shift_mm: PositionerShift | None = Field(
        default=None, description="The same in the C-arm's own axes; null until the display's rotation is known."
    )
    age_s: float | None
    validity: Literal["current", "stale"]
    stale_because: str | None


class HoleTilt(ReceivedModel):
    """How far a hole's axis is tilted against the X-ray through it."""

    id: str
    tilt_to_ray_deg: float


class AlignmentView(ReceivedModel):
    """How to turn the C-arm, from the newest localisation. Null where that one did not get so far.

    While fluoroscopy runs, `guidance` is newer: it follows every frame, a localisation takes seconds.
    """

    localisation: int
    image: str
    verdict: str
    reason_codes: tuple[str, ...]
    c_arm_correction_deg: CArmCorrection | None
    tilts: tuple[HoleTilt, ...]
    assessment: ViewAssessment | None
    off_centre_mm: OffCentre | None
    age_s: float
    validity: Literal["current", "stale"]
    stale_because: str | None
    guidance: GuidanceView | None


class ApprovalBody(SentModel):
    """A surgeon's consent to the plan whose ETag is quoted in If-Match."""

    password: str | None = Field(
        default=None,
        repr=False,
        description="The approving surgeon's, once more. Not needed with a passkey or the simulation's token.",
    )
    passkey: Mapping[str, object] | None = Field(
        default=None,
        description="In place of the password: the challenge of POST /users/me/passkeys/challenge, signed.",
    )


class ApprovalView(ReceivedModel):
    """A surgeon's consent."""

    plan: int
    plan_sha256: str
    approved_by: str
    approved_at_ns: int
    authenticated_by: str | None = Field(
        description="How the surgeon showed who he is: `password`, or `simulation_token`; null in old records."
    )


class CaseBody(SentModel):
    """Opens a case."""

    side: Literal["left", "right"]
    bone: Literal["femur", "tibia"]
    mount: Literal["bone", "nail_head"]
    nail: str | Mapping[str, object]
    guide: str | Mapping[str, object]
    ring: str | Mapping[str, object]
    hexapod: str | Mapping[str, object] = Field(default="hexapod-h70")
    head_extension_mm: float
    guide_calibration: Mapping[str, object] | None = Field(
        default=None,
        description="What `distalock robot calibrate-guide` printed: the hexapod's head is then as found. Or the guide file of this very guide as measured, in place of the nominal one.",
    )
    nominal_source_to_detector_mm: float | None = Field(default=None)
    nominal_pixel_mm: float | None = Field(default=None)
    drill_diameter_mm: float = Field(default=4.0)


class CasePatch(SentModel):
    """Changes the set-up of a case; what is left out stays as it is."""

    side: Literal["left", "right"] | None = Field(default=None)
    bone: Literal["femur", "tibia"] | None = Field(default=None)
    mount: Literal["bone", "nail_head"] | None = Field(default=None)
    nail: str | Mapping[str, object] | None = Field(default=None)
    guide: str | Mapping[str, object] | None = Field(default=None)
    ring: str | Mapping[str, object] | None = Field(default=None)
    hexapod: str | Mapping[str, object] | None = Field(default=None)
    head_extension_mm: float | None = Field(default=None)
    guide_calibration: Mapping[str, object] | None = Field(default=None)
    nominal_source_to_detector_mm: float | None = Field(default=None)
    nominal_pixel_mm: float | None = Field(default=None)
    drill_diameter_mm: float | None = Field(default=None)
    why: str = Field(default="")


class PartView(ReceivedModel):
    """A part file in use."""

    name: str
    sha256: str
    hole_ids: tuple[str, ...]


class InsideView(ReceivedModel):
    """Something in a hole of the guide or the bone."""

    kind: Literal["wire", "drill", "screw"]
    hole_id: str


class PhaseView(ReceivedModel):
    """A phase on the line of the procedure."""

    name: str
    status: Literal["done", "now", "to_come"]


class ProcedureView(ReceivedModel):
    """How far the case is, and what may come next."""

    stage: str
    aim: str
    phase: str = Field(description="Where the case is in the protocol, from `set_up` to `closed`.")
    line: tuple[PhaseView, ...] = Field(
        description="The phases in order, with a detour only while it lasts; what is done may have to be done again."
    )
    wired_hole_ids: tuple[str, ...]
    inside: tuple[InsideView, ...] = Field(
        description="What is in the guide or the bone: until it is out, nothing moves."
    )
    drilled_hole_ids: tuple[str, ...]
    allowed_actions: tuple[str, ...]
    allowed_steps: tuple[str, ...] = Field(description="Steps that are in order now; others need `why`.")
    actions: tuple[ActionView, ...] = Field(description="Every action, with who may, and why not where it is refused.")
    steps: tuple[ActionView, ...] = Field(description="The same for every step that can be recorded.")
    next: str = Field(description="What to do next, in one sentence.")
    next_action: str | None = Field(description="The action or step that `next` asks for; null where it is to wait.")


class CaseView(ReceivedModel):
    """A case: its set-up and the state of its procedure."""

    id: str
    revision: int = Field(description="Counts up with every change of the set-up; older results are then stale.")
    opened_at_ns: int
    changed_at_ns: int
    side: str
    bone: str
    mount: str
    head_extension_mm: float
    ring: PartView
    guide: PartView
    nail: PartView
    hexapod: PartView
    guide_calibrated: bool
    hole_ids: tuple[str, ...]
    nominal_source_to_detector_mm: float | None
    nominal_pixel_mm: float | None
    drill_diameter_mm: float
    images: int
    localisations: int
    plans: int
    verifications: int
    motions: tuple[str, ...]
    procedure: ProcedureView


class CatalogueView(ReceivedModel):
    """One part in the catalogue."""

    name: str
    kind: Literal["ring", "guide", "nail", "hexapod"]
    sha256: str
    bone: Literal["femur", "tibia"] | None = Field(description="That a nail is made for; null of other parts.")


class ChallengeBody(SentModel):
    """Which plan is to be approved: the passkey signs for this one alone."""

    plan_sha256: str


class CheckView(ReceivedModel):
    """One part that a procedure needs: what was measured, and what to do when it is not as it should be."""

    name: str
    ok: bool
    code: str
    measured: str
    remedy: str


class CommandBody(SentModel):
    """Asks the robot to reference, to acknowledge a stop, or to reset; may be left out."""


class PlanBody(SentModel):
    """Asks for a plan from a localisation, by its number in the case."""

    localisation: int
    hole_ids: Sequence[str]
    localisations: Sequence[int] = Field(
        default=(),
        description="Localisations of the same set-up to fuse with it: same revision, robot in the same place.",
    )
    verification: int | None = Field(
        default=None,
        description="The last verification, of the localisation's image: its wires are brought onto the holes.",
    )


class QaBody(SentModel):
    """Asks for a quality report over images of the case."""

    images: Sequence[str]


class VerificationBody(SentModel):
    """Asks for a verification from one image or two."""

    images: Sequence[str]
    of: Literal["wires", "guide"] = Field(
        default="wires",
        description="`wires` in the guide's holes, or `guide`: its own holes, from images without wires.",
    )


class ComputationBody(SentModel):
    """What to compute: exactly one of the three, each as in the body of its own `POST`, which waits for the answer."""

    verification: VerificationBody | None = Field(default=None)
    qa_report: QaBody | None = Field(default=None)
    plan: PlanBody | None = Field(default=None)


class Curvature(ReceivedModel):
    """Of a bent nail's centre line at the nail's origin, towards y and z of the nail's frame."""

    y_per_m: float
    z_per_m: float
    radius_mm: float
    standard_uncertainty_per_m: float


Verdict = Literal["well", "attention", "wrong", "not looked at"]


class FindingView(ReceivedModel):
    """One thing that was looked at."""

    name: str
    verdict: Verdict
    measured: str
    remedy: str = Field(description="What to do; empty where nothing is to be done.")


class DiagnosisView(ReceivedModel):
    """Everything that was looked at, and the worst of it."""

    verdict: Verdict
    findings: tuple[FindingView, ...]


class DrawnBall(ReceivedModel):
    """A ball of ring or guide."""

    id: str
    centre_px: tuple[float, float] = Field(
        description="Where it was measured; of a ball that was not used, where it must be."
    )
    radius_px: float
    used: bool = Field(description="Whether calibration or guide pose rests on it.")
    residual_px: float | None = Field(
        description="Distance from where calibration and pose predict it; null for a ball that was not used."
    )


class DrawnEllipse(ReceivedModel):
    """An ellipse in pixels."""

    centre_px: tuple[float, float]
    semi_major_px: float
    semi_minor_px: float
    major_axis_deg: float = Field(description="Direction of the major axis, from the columns' to the rows' direction.")


class DrawnHole(ReceivedModel):
    """A hole of the nail.

    Attributes
    ----------
    mm_per_px
        Length at the hole's depth that one pixel covers.
    entry_95, exit_95
        95 % ellipses of where the hole's axis crosses its entry and its exit, against the guide. None of a hole that is
        not localised, and where the errors are not estimated.
    """

    id: str
    localised: bool
    centre_px: tuple[float, float]
    mm_per_px: float
    rims_px: tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]] = Field(
        description="Where it meets the nail's surface, at entry and exit."
    )
    axis_px: tuple[tuple[float, float], ...] = Field(description="From the surgeon's side to the exit.")
    entry_95: DrawnEllipse | None
    exit_95: DrawnEllipse | None


class DrawnPath(ReceivedModel):
    """Where a drill goes that is led by the guide's hole of this name, as the guide stands in the image."""

    id: str
    axis_px: tuple[tuple[float, float], ...] = Field(description="From the surgeon's side to where it leaves the nail.")
    edges_px: tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]] = Field(
        description="Both sides of the drill."
    )
    rims_px: tuple[tuple[tuple[float, float], ...], ...] = Field(
        description="The drill's circumference in the planes of the nail hole's entry and exit; empty without a nail."
    )


class DrawnScrew(ReceivedModel):
    """A screw of the mount where it is advised."""

    id: Literal["distal", "proximal"]
    shown: bool
    axis_px: tuple[tuple[float, float], ...]
    radius_px: float


class Drawing(ReceivedModel):
    """Everything in the pixels of one view."""

    ring_balls: tuple[DrawnBall, ...]
    guide_balls: tuple[DrawnBall, ...]
    nail_edges_px: tuple[tuple[tuple[float, float], ...], ...] = Field(
        description="The nail's two sides; empty without a nail."
    )
    holes: tuple[DrawnHole, ...]
    drill_paths: tuple[DrawnPath, ...]
    mounting_screws: tuple[DrawnScrew, ...]


class FrameHeader(ReceivedModel):
    """Describes one image; travels as the attachment of its pixels.

    The pixels are little-endian float32, row by row, normalised so that darker (smaller) is denser, otherwise as the
    C-arm sent them: never resampled, never un-mirrored.
    """

    schema_name: Literal["distalock/frame/1"] = Field(default="distalock/frame/1", alias="schema")
    sha256: str = Field(description="Of the stored file, DICOM as received or as made by imaging.")
    sop_instance_uid: str
    sequence: int = Field(
        description="Number in the image store, which gives one to every image: from 1, without a gap, over all restarts."
    )
    boot_epoch: str
    received_at_ns: int = Field(description="For people: never compared.")
    width_px: int
    height_px: int
    pixel_format: Literal["float32"] = Field(default="float32")
    bits_stored: int
    case_id: str | None
    case_revision: int
    manufacturer: str = Field(default="")
    model_name: str = Field(default="")
    nominal_source_to_detector_mm: float
    nominal_pixel_mm: float
    positioner_primary_angle_deg: float | None = Field(default=None)
    positioner_secondary_angle_deg: float | None = Field(default=None)
    laterality: Literal["left", "right"] | None = Field(
        default=None, description="Side of the body, as the file states it."
    )
    run_interval_s: float | None = Field(
        default=None,
        description="Present when the image is part of a run of images (running fluoroscopy): it was received within this time after the image before it, in seconds. The run ends when no image follows within this time. The first image of a run has none, and neither has a single shot.",
    )
    focal_spot_mm: float | None = Field(default=None)
    inverted: bool = Field(default=False, description="Pixels are reversed against what the file states.")
    notes: tuple[str, ...] = Field(
        default=(), description="Header values that were ignored, and nominal values that were assumed."
    )
    store_id: str | None = Field(
        default=None,
        description="Names the image store in which `sequence` counts. Images of two stores have no order.",
    )
    age_s: float | None = Field(
        default=None,
        description="Time since the image was received, in seconds on monotonic clocks, when this message was published. None: imaging has started anew since then, and nobody knows.",
    )


class FusedImage(ReceivedModel):
    """What became of one of several images of a set-up.

    Attributes
    ----------
    used
        Whether the joint estimate rests on it: it was accepted, or rejected for nothing but its own uncertainty.
    chi_square
        By how much the joint chi-square grew through it, about 9 when all is well; None when it was not used, or alone.
    """

    sha256: str
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[ReasonMessage, ...]
    used: bool
    chi_square: float | None


class Fusion(ReceivedModel):
    """How several images of one set-up agree, in the order in which they were taken."""

    images: tuple[FusedImage, ...]
    chi_square: float
    chi_square_limit: float
    degrees_of_freedom: int


class HealthView(ReceivedModel):
    """The process runs."""

    status: str
    version: str


class ImageDrawing(ReceivedModel):
    """An image's drawing, in the pixels of the image as received and of the corrected one; both un-mirrored.

    Attributes
    ----------
    mirrored
        Column x is then column ``width_px - 1 - x`` of the image as received.
    mm_per_px_at_detector
        Length that one pixel covers at the ring's plate next to the detector.
    """

    schema_name: Literal["distalock/drawing/1"] = Field(default="distalock/drawing/1", alias="schema")
    image_sha256: str
    width_px: int
    height_px: int
    mirrored: bool
    mm_per_px_at_detector: float
    raw: Drawing
    corrected: Drawing


class SkipView(ReceivedModel):
    """Why an image was not calibrated or not localised."""

    step: str
    code: str
    message: str


class ImageView(ReceivedModel):
    """An image of a case. `header` is null when the image itself was dropped on the bus but a result of it came."""

    id: str
    case_id: str
    case_revision: int
    sop_instance_uid: str
    received_at_ns: int
    header: FrameHeader | None
    localisation: int | None = Field(description="Number of the newest localisation made from it.")
    calibrated: bool | None = Field(description="Null until imaging has reported.")
    skipped: SkipView | None = Field(description="Why there is no calibration or no localisation and will be none.")
    operation: str | None = Field(
        description="Id of its way to the localisation (GET /operations/{id}); null of a frame that nobody localises."
    )
    age_s: float = Field(description="Time since it was received, as the gateway's clock has it; for people.")


class LeaseView(ReceivedModel):
    """A renewed hold-to-move lease."""

    operation: str
    expires_in_s: float


class LocalisedCamera(ReceivedModel):
    """The C-arm as the ring shows it."""

    intrinsic_matrix_px: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    camera_from_ring: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    balls_found: int
    balls_expected: int
    distortion_residual_px: float
    reprojection_rms_px: float


class LocalisedGuide(ReceivedModel):
    """The drill guide."""

    camera_from_guide: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    balls_found: int
    balls_expected: int
    reprojection_rms_px: float


class StandardUncertainty(ReceivedModel):
    """Predicted rms of the two errors that count."""

    entry_mm: float
    axis_deg: float


class LocalisedHole(ReceivedModel):
    """One nail hole's axis in the guide's frame."""

    id: str
    entry_point_guide_mm: tuple[float, float, float]
    axis_guide: tuple[float, float, float]
    tilt_to_ray_deg: float
    chance_to_pass: float | None
    standard_uncertainty: StandardUncertainty | None


class LocalisedImage(ReceivedModel):
    """Which image, and how it was shown."""

    sha256: str
    mirrored: bool | None


class LocalisedNail(ReceivedModel):
    """The nail; `mirror_margin` is None for methods that know no mirror optimum, `curvature` for a straight nail."""

    camera_from_nail: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    mirror_margin: float | None
    curvature: Curvature | None = Field(default=None)


class MountingSiteMessage(ReceivedModel):
    """Where the two screws that hold the robot's base go in the bone, from an image of the nail without a guide."""

    head_extension_mm: float = Field(description="To which the head is then set: the guide stands over the holes.")
    screws: tuple[AdvisedScrew, AdvisedScrew]
    screw_diameter_mm: float
    range_px: tuple[tuple[float, float], tuple[float, float]] = Field(
        description="Ends on the nail of where screws may be."
    )


class PlatformPoseMessage(ReceivedModel):
    """Platform pose as the controller counts it: X Y Z in mm, U V W in degrees, about the pivot."""

    x_mm: float
    y_mm: float
    z_mm: float
    u_deg: float
    v_deg: float
    w_deg: float


class Provenance(ReceivedModel):
    """Where a localisation comes from."""

    case_id: str
    case_revision: int
    registration_epoch: str
    robot_boot_epoch: str | None
    robot_pose: PlatformPoseMessage | None
    sop_instance_uid: str
    received_at_ns: int
    ring_sha256: str
    guide_sha256: str
    nail_sha256: str
    software_version: str


class Timing(ReceivedModel):
    """Wall time of the steps."""

    total: float
    ring: float | None = Field(default=None)
    guide: float | None = Field(default=None)
    nail: float | None = Field(default=None)


class LocalisationView(ReceivedModel):
    """What `distalock locate` prints, with its number in the case, its age, whether it still holds, and provenance."""

    schema_name: Literal["distalock/localisation/1"] = Field(default="distalock/localisation/1", alias="schema")
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[ReasonMessage, ...]
    method: Literal["model", "fronto-parallel"]
    image: LocalisedImage
    camera: LocalisedCamera | None
    guide: LocalisedGuide | None
    nail: LocalisedNail | None
    guide_from_nail: (
        tuple[
            tuple[float, float, float, float],
            tuple[float, float, float, float],
            tuple[float, float, float, float],
            tuple[float, float, float, float],
        ]
        | None
    )
    holes: tuple[LocalisedHole, ...] | None
    c_arm_correction_deg: CArmCorrection | None
    timing_ms: Timing
    image_file: str | None = Field(default=None)
    notes: tuple[str, ...] = Field(
        default=(), description="Header values that were ignored, and nominal values that were assumed."
    )
    number: int
    age_s: float
    validity: Literal["current", "stale"]
    stale_because: str | None
    mounting_site: MountingSiteMessage | None
    provenance: Provenance


class LoginBody(SentModel):
    """Opens a session."""

    name: str
    password: str = Field(repr=False)
    keep: Literal["bearer", "cookie"] = Field(
        default="bearer",
        description="`bearer`: the tokens are in the answer, for programs. `cookie`: they are in cookies that scripts cannot read, for pages.",
    )


class MeView(ReceivedModel):
    """Who is signed in, and what he may do."""

    name: str
    roles: tuple[str, ...]
    actions: tuple[str, ...]
    authenticated_by: str = Field(description="`password`, or `simulation_token` in a simulation.")
    banner: str | None = Field(description="What every page must show at all times; null outside simulations.")


class MotionBody(SentModel):
    """Starts the motion of an approved plan."""

    plan: int
    hold_to_move: bool = Field(
        default=False, description="Motion stops unless PUT /operations/{id}/lease is repeated within its lease."
    )


MotionState = Literal["disconnected", "unreferenced", "referencing", "locked", "moving", "stopped", "fault"]


class ProgressView(ReceivedModel):
    """How far an operation has come."""

    step: int = Field(description="Which of the steps, from 1.")
    steps: int
    says: str = Field(description="What is done in this step.")
    fraction: float | None = Field(
        description="Of the whole: of a move, the share of its way that lies behind it; null where nobody knows."
    )


class OperationView(ReceivedModel):
    """What takes time, and how far it has come; `began` is null while nobody knows.

    A command to the robot (`move`, `reference`, `acknowledge_stop`, `reset`), something that is computed (`verify`,
    `report_quality`, `plan`), or an image on its way to its localisation (`localise`), for which nobody asks.
    """

    id: str
    verb: str
    case_id: str | None
    plan: int | None
    hold_to_move: bool
    status: Literal["running", "unknown", "succeeded", "failed", "stopped", "cancelled"] = Field(
        description="`unknown`: the robot has not answered; its state will tell. The last four are final."
    )
    progress: ProgressView
    ended_by: Literal["cancel", "stop"] | None = Field(
        description="How it can be ended now: `cancel` (POST /operations/{id}/cancel), or `stop` (POST /robot/stop) of what moves the robot; null of what has ended, or takes but a moment."
    )
    began: bool | None
    code: str
    detail: str
    result: str | None = Field(description="Path of what was computed, once it has succeeded.")
    deviation_mm: float | None = Field(description="Read-back minus target, once the move has ended.")
    deviation_deg: float | None
    requested_at_ns: int
    ended_at_ns: int | None
    approver: str | None = Field(description="Who approved the plan, or asked for the reference.")
    authenticated_by: str | None = Field(description="How the approver showed who he is.")
    permit_sha256: str | None = Field(description="The permit that went with it: its text's hash.")


class PredictedHoleError(ReceivedModel):
    """What remains at one hole after the planned move: its bias (unequal spacings) and standard uncertainty."""

    id: str
    offset_mm: float
    angle_deg: float
    standard_uncertainty: StandardUncertainty
    chance_to_pass: float


class Plan(ReceivedModel):
    """A move of the hexapod, ready for approval. Its hash names exactly this content."""

    schema_name: Literal["distalock/plan/1"] = Field(default="distalock/plan/1", alias="schema")
    case_id: str
    case_revision: int
    image_sha256: str
    registration_epoch: str
    robot_boot_epoch: str
    hexapod_sha256: str
    hole_ids: tuple[str, ...]
    head_extension_mm: float
    guide_from_target_guide: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    start_pose: PlatformPoseMessage
    target_pose: PlatformPoseMessage
    pivot_mm: tuple[float, float, float]
    target_leg_lengths_mm: tuple[float, float, float, float, float, float]
    travel_mm: float
    travel_deg: float
    axial_shift_mm: float = Field(description="Free travel along the drilling axis that was used to stay in reach.")
    predicted: tuple[PredictedHoleError, ...]
    fusion: Fusion | None = Field(default=None, description="What it rests on when that is more than one image.")
    verified_image_sha256: tuple[str, ...] = Field(
        default=(),
        description="Images of the verification whose residual it corrects; empty for a plan from localisations.",
    )
    image_age_s: float | None = Field(
        default=None,
        description="Age of the image when this message was published, in seconds on monotonic clocks: what imaging stated, and the time since then. None: not known, because imaging or registration has started anew since the image was received. Of several images, of the oldest.",
    )


class PlanView(ReceivedModel):
    """A plan, ready for approval; `sha256` is also its ETag."""

    number: int
    sha256: str
    localisation: int
    made_at_ns: int
    approval: ApprovalView | None
    validity: str = Field(description="`current`, or `stale` when it moves nothing any more.")
    stale_because: str | None
    plan: Plan


class QaBall(ReceivedModel):
    """One ball of the ring over all accepted images."""

    id: str
    seen: int
    shift_x_mm: float = Field(description="Middle residual over the images, in the frame of the ring.")
    shift_y_mm: float
    rms_mm: float
    sigmas: float = Field(description="Length of the median over its standard error.")
    flagged: bool


class QaDrift(ReceivedModel):
    """What changed since the last report."""

    since: str
    source_mm: tuple[float, float, float]
    distortion_rms_px: float
    worst_ball: str
    worst_ball_mm: float


class QaImage(ReceivedModel):
    """One image; figures are None when it was refused."""

    name: str
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[ReasonMessage, ...] = Field(default=())
    balls_found: int = Field(default=0)
    source_mm: tuple[float, float, float] | None = Field(default=None, description="Focal spot in the ring's frame.")
    source_deviation_mm: tuple[float, float, float] | None = Field(default=None)
    mirrored: bool | None = Field(default=None)
    reprojection_rms_px: float | None = Field(default=None)
    distortion_residual_px: float | None = Field(default=None)
    central_deviation_px: float | None = Field(default=None)


class QaReportView(ReceivedModel):
    """What `distalock qa` writes, with its number in the case."""

    schema_name: Literal["distalock/qa/1"] = Field(default="distalock/qa/1", alias="schema")
    made_at: str
    software_version: str
    ring_sha256: str
    verdict: Literal["good", "attention"]
    findings: tuple[str, ...]
    images: tuple[QaImage, ...]
    balls: tuple[QaBall, ...]
    mean_source_mm: tuple[float, float, float] | None
    distortion_px: tuple[tuple[float, float], ...] = Field(
        description="Mean distortion at 9 x 9 places of the ring's plane, in its frame, without shift, turn and scale."
    )
    drift: QaDrift | None
    number: int


class StepView(ReceivedModel):
    """A step that was recorded and not withdrawn."""

    number: int
    step: str
    hole_ids: tuple[str, ...] = Field(description="Empty: it concerned all holes.")
    out_of_order: bool
    why: str


class TimelineEntry(ReceivedModel):
    """One thing that happened."""

    sequence: int = Field(description="Number of its event in the log.")
    at: datetime
    at_ns: int
    who: str
    kind: str
    what: str = Field(description="One sentence.")
    why: str
    href: str | None = Field(description="What it made, or what it is about.")
    picture: str | None = Field(description="The picture that shows it.")


class UserView(ReceivedModel):
    """An account."""

    name: str
    roles: tuple[str, ...]
    disabled: bool
    created_at_ns: int


class VerifiedGuideHole(ReceivedModel):
    """The guide hole's own axis against the nail hole's, from the same images: what a drill will follow."""

    id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    standard_uncertainty: StandardUncertainty
    chance_to_pass: float


class VerifiedWire(ReceivedModel):
    """One wire's axis against the axis of the nail hole of the same id."""

    id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float
    standard_uncertainty: StandardUncertainty
    chance_to_pass: float


class VerificationView(ReceivedModel):
    """What `distalock verify` prints, with its number in the case."""

    schema_name: Literal["distalock/verification/1"] = Field(default="distalock/verification/1", alias="schema")
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[ReasonMessage, ...]
    images: tuple[str, ...]
    wires: tuple[VerifiedWire, ...]
    guide_holes: tuple[VerifiedGuideHole, ...] = Field(default=())
    of: Literal["wires", "guide"] = Field(
        default="wires", description="What was to be verified: wires, or the guide alone."
    )
    notes: tuple[str, ...] = Field(
        default=(), description="Header values that were ignored, and nominal values that were assumed."
    )
    number: int


class PasskeyBody(SentModel):
    """A new passkey, with the password once more: a session that was left open registers none."""

    label: str = Field(description="For people: which phone or key it is in.")
    password: str | None = Field(
        default=None,
        repr=False,
        description="The own one. Not needed in the first five minutes after signing in with a provider.",
    )
    credential: Mapping[str, object]


class PasskeyOptions(ReceivedModel):
    """What a page hands to `navigator.credentials`, in the JSON form of WebAuthn Level 3."""

    public_key: dict[str, object]
    expires_in_s: float


class PasskeyView(ReceivedModel):
    """A passkey, without its key."""

    id: str
    label: str
    created_at_ns: int


class PasskeysView(ReceivedModel):
    """All passkeys of the own account, the oldest first."""

    items: tuple[PasskeyView, ...]


class PasswordBody(SentModel):
    """Changes the own password; the other sessions end."""

    password: str = Field(repr=False)
    new_password: str = Field(repr=False)


class ReadyView(ReceivedModel):
    """Everything that a procedure needs is there."""

    status: str
    checks: tuple[CheckView, ...]


class RefreshBody(SentModel):
    """Renews a session; a page leaves the token out, for it is in its cookie."""

    refresh_token: str | None = Field(default=None, repr=False)


StopButton = Literal["absent", "pressed", "released", "clear"]


StopLatch = Literal["clear", "latched"]


class RobotState(ReceivedModel):
    """Everything others may know of the robot, published on change and at a steady rate."""

    schema_name: Literal["distalock/robot-state/1"] = Field(default="distalock/robot-state/1", alias="schema")
    boot_epoch: str
    sequence: int
    sent_at_ns: int = Field(description="For people: never compared.")
    state: MotionState
    stop: StopLatch
    locked: bool = Field(description="Brake on and servo off, as read back from the controller.")
    referenced: bool
    pose: PlatformPoseMessage | None = Field(
        description="Null when it is not known; in `locked` or `stopped`: the controller has not answered in the last round, and `locked` and `referenced` are not known either."
    )
    leg_lengths_mm: tuple[float, float, float, float, float, float] | None
    pivot_mm: tuple[float, float, float]
    hexapod_sha256: str
    controller_identity: str = Field(default="", description="What the controller answered to *IDN?.")
    registration_epoch: str | None = Field(default=None, description="Newest epoch the robot has heard of.")
    command_id: str | None = Field(default=None, description="Command being carried out, or the last one.")
    outcome: Literal["none", "moving", "reached", "stopped", "failed"] = Field(
        default="none", description="How the command in `command_id` ended, or that it is under way."
    )
    deviation_mm: float | None = Field(default=None, description="Read-back minus target after the last move.")
    deviation_deg: float | None = Field(default=None)
    detail: str = Field(default="")
    clock_s: float | None = Field(
        default=None,
        description="Monotonic clock of the robot service when it sent this: compared only with that of another state of the same boot epoch.",
    )
    stop_button: StopButton = Field(default="absent", description="The controller's own button, as far as it says.")
    permit_sha256: str | None = Field(default=None, description="Hash of the permit that was taken last.")
    permits_refused: int = Field(default=0, description="How many permits this run of the service has refused.")
    permit_refusal: str = Field(default="", description="Code with which the last of them was refused.")


class RobotView(ReceivedModel):
    """The robot as last seen, with its age."""

    state: RobotState | None
    age_s: float | None
    validity: str = Field(description="`current`, `stale`, or `absent` when it was never seen.")
    service_alive: bool
    simulated: bool | None = Field(description="Read from the controller's `*IDN?`; null when it has not said.")
    image_source: str = Field(description="Manufacturer and model in the newest image.")
    image_source_simulated: bool | None
    actions: tuple[ActionView, ...] = Field(description="What may be done with it now, by whom, and why not.")


class SessionView(ReceivedModel):
    """A session. The tokens are null where they are in cookies."""

    user: str
    roles: tuple[str, ...]
    access_token: str | None
    refresh_token: str | None = Field(description="Good for one renewal; used a second time, it ends the session.")
    access_expires_in_s: float
    session_expires_in_s: float


class StepBody(SentModel):
    """What people did with their hands. Without `hole_ids` it concerns all holes."""

    step: Literal[
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
    hole_ids: Sequence[str] = Field(default=())
    why: str = Field(default="", description="Needed when the step is out of order.")


class StopView(ReceivedModel):
    """A confirmed stop: written, and the controller shows standstill with brakes on. Anything else is a 504."""

    confirmed: bool
    state: str | None
    detail: str
    recorded: bool


class UserBody(SentModel):
    """Makes an account."""

    name: str
    password: str = Field(repr=False)
    roles: Sequence[Literal["viewer", "technician", "surgeon", "administrator"]] = Field(
        description="One role, or several."
    )


class UserPatch(SentModel):
    """Changes an account; what is left out stays. All its sessions end."""

    password: str | None = Field(default=None, repr=False)
    roles: Sequence[Literal["viewer", "technician", "surgeon", "administrator"]] | None = Field(default=None)
    disabled: bool | None = Field(default=None)


class WaysView(ReceivedModel):
    """How one can sign in: with name and password (`POST /sessions`), and where there is one with a provider."""

    provider: str | None = Field(
        description="The identity provider's name; browsers go to GET /sessions/provider. Null where there is none."
    )


class Place(ReceivedModel):
    """One thing that is wrong with a request, and where."""

    place: str
    message: str


class Problem(ReceivedModel):
    """RFC 9457 problem document."""

    type: str
    title: str
    status: int
    detail: str
    code: str
    instance: str
    errors: tuple[Place, ...] | None = Field(default=None)
    checks: tuple[dict[str, str | bool], ...] | None = Field(default=None)
    current: dict[str, object] | None = Field(default=None)
