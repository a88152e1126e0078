"""What registration publishes and answers: localisations, plans, verifications."""

import hashlib
from typing import Annotated, Literal

from pydantic import Field

from shared.messages.base import (
    Finite,
    Identifier,
    Matrix3,
    Matrix4,
    Message,
    MessageModel,
    Pixel,
    ReasonMessage,
    Sha256,
    Vector3,
    Verdict,
    encode,
    is_empty,
)
from shared.messages.drawing import ImageDrawing
from shared.messages.imaging import ImageAge, ImageReference
from shared.messages.robot import PlatformPoseMessage

IMAGE_AGE = (
    "Age of the image when this message was published, in seconds on monotonic clocks: what imaging stated, and the "
    "time since then. None: not known, because imaging or registration has started anew since the image was received."
)
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Method = Literal["model", "fronto-parallel"]
# What is compared with the axes of the nail's holes.
VerificationOf = Literal["wires", "guide"]


class LocalisedImage(MessageModel):
    """Which image, and how it was shown."""

    sha256: Sha256
    mirrored: bool | None


class LocalisedCamera(MessageModel):
    """The C-arm as the ring shows it."""

    intrinsic_matrix_px: Matrix3
    camera_from_ring: Matrix4
    balls_found: int
    balls_expected: int
    distortion_residual_px: Finite
    reprojection_rms_px: Finite


class LocalisedGuide(MessageModel):
    """The drill guide."""

    camera_from_guide: Matrix4
    balls_found: int
    balls_expected: int
    reprojection_rms_px: Finite


class Curvature(MessageModel):
    """Of a bent nail's centre line at the nail's origin, towards y and z of the nail's frame."""

    y_per_m: Finite
    z_per_m: Finite
    radius_mm: Finite
    # Predicted rms of the error of the curvature
    standard_uncertainty_per_m: Finite


class LocalisedNail(MessageModel):
    """The nail; `mirror_margin` is None for methods that know no mirror optimum, `curvature` for a straight nail."""

    camera_from_nail: Matrix4
    mirror_margin: Finite | None
    curvature: Curvature | None = None


class StandardUncertainty(MessageModel):
    """Predicted rms of the two errors that count."""

    entry_mm: Finite
    axis_deg: Finite


class LocalisedHole(MessageModel):
    """One nail hole's axis in the guide's frame."""

    id: str
    entry_point_guide_mm: Vector3
    axis_guide: Vector3
    tilt_to_ray_deg: Finite
    chance_to_pass: Probability | None
    standard_uncertainty: StandardUncertainty | None


class CArmCorrection(MessageModel):
    """How to turn source and detector together, about the camera frame's axes, right-handed."""

    about_image_x: Finite
    about_image_y: Finite


class ViewAssessment(MessageModel):
    """How well the C-arm looks along the holes: `too_far` is refused, and of a `good` view no better one is needed.

    Attributes
    ----------
    saved_by_a_degree
        Share of the axis's error that one degree less tilt would take away, from the accuracy benchmark.
    """

    quality: Literal["good", "usable", "too_far"]
    largest_tilt_deg: Finite
    saved_by_a_degree: Probability


class OffCentre(MessageModel):
    """How far the holes' middle lies off the picture's, un-mirrored, in mm at their depth: move the C-arm so."""

    to_image_right: Finite
    to_image_down: Finite


class Timing(MessageModel):
    """Wall time of the steps."""

    total: Finite
    ring: Finite | None = None
    guide: Finite | None = None
    nail: Finite | None = None


class Localisation(Message):
    """What `distalock locate` prints: both axes from one image, or the reasons for rejection.

    Attributes
    ----------
    image_file
        The image's name, in the lines of `distalock locate --each` only.
    """

    schema_name: Literal["distalock/localisation/1"] = Field("distalock/localisation/1", alias="schema")
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...]
    method: Method
    image: LocalisedImage
    camera: LocalisedCamera | None
    guide: LocalisedGuide | None
    nail: LocalisedNail | None
    guide_from_nail: Matrix4 | None
    holes: tuple[LocalisedHole, ...] | None
    c_arm_correction_deg: CArmCorrection | None
    timing_ms: Timing
    image_file: str | None = Field(None, exclude_if=lambda name: name is None)
    notes: tuple[str, ...] = Field(
        (), description="Header values that were ignored, and nominal values that were assumed.", exclude_if=is_empty
    )


class UnreadableImage(Message):
    """The line of `distalock locate --each` for a file that is not an image that can be measured."""

    schema_name: Literal["distalock/unreadable-image/1"] = Field("distalock/unreadable-image/1", alias="schema")
    image_file: str
    error: str


class FusedImage(MessageModel):
    """What became of one of several images of a set-up.

    Attributes
    ----------
    used
        Whether the joint estimate rests on it: it was accepted, or rejected for nothing but its own uncertainty.
    chi_square
        By how much the joint chi-square grew through it, about 9 when all is well; None when it was not used, or alone.
    """

    sha256: Sha256
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...]
    used: bool
    chi_square: Finite | None


class Fusion(MessageModel):
    """How several images of one set-up agree, in the order in which they were taken."""

    images: tuple[FusedImage, ...]
    chi_square: Finite
    chi_square_limit: Finite
    degrees_of_freedom: int = Field(ge=0)


class AdvisedScrew(MessageModel):
    """The axis of one screw of the mount, for the jig; pixels are those of the un-mirrored image."""

    id: Literal["distal", "proximal"]
    proximal_mm: Finite = Field(description="From the middle between the nail's holes, along the nail.")
    outside_px: Pixel = Field(description="A point of the axis towards the surgeon.")
    at_nail_px: Pixel = Field(description="Where the axis would meet the nail; the screw ends in the near cortex.")
    tilt_to_ray_deg: Finite = Field(description="Between the axis and the X-ray to it.")
    shown: bool = Field(description="Whether the image shows this place.")


class MountingSiteMessage(MessageModel):
    """Where the two screws that hold the robot's base go in the bone, from an image of the nail without a guide."""

    head_extension_mm: Finite = Field(description="To which the head is then set: the guide stands over the holes.")
    screws: tuple[AdvisedScrew, AdvisedScrew]
    screw_diameter_mm: Finite
    range_px: tuple[Pixel, Pixel] = Field(description="Ends on the nail of where screws may be.")


class MountingAdvice(Message):
    """What `distalock mounting-site` prints: where the mount's screws go, or why the image does not say."""

    schema_name: Literal["distalock/mounting-advice/1"] = Field("distalock/mounting-advice/1", alias="schema")
    image: LocalisedImage
    reasons: tuple[ReasonMessage, ...]
    mounting_site: MountingSiteMessage | None


class LocalisationRecord(Message):
    """A localisation with its provenance, as registration publishes it for every image of an open case.

    Attributes
    ----------
    registration_epoch
        Names the newest state of registration: ``{boot epoch of registration}.{counter}``. It changes with every new
        image and every change of the case's set-up; anything that quotes an older epoch is stale and moves nothing.
    robot_pose
        Platform pose when the image arrived; None when the robot was unknown or moving, and then no plan can be made.
    """

    schema_name: Literal["distalock/localisation-record/1"] = Field("distalock/localisation-record/1", alias="schema")
    localisation: Localisation
    image: ImageReference
    case_id: Identifier
    case_revision: int = Field(ge=0)
    registration_epoch: Identifier
    robot_boot_epoch: Identifier | None
    robot_pose: PlatformPoseMessage | None
    ring_sha256: Sha256
    guide_sha256: Sha256
    nail_sha256: Sha256
    software_version: str
    overlay_png_base64: str | None = Field(None, description="What was found, drawn on the image, for people.")
    image_age_s: ImageAge = Field(None, description=IMAGE_AGE)
    mounting_site: MountingSiteMessage | None = Field(
        None, description="Where to mount the robot: of an image that shows the nail and no guide."
    )
    drawing: ImageDrawing | None = Field(
        None, description="What was found as vectors, for viewers; null when the ring was not found."
    )
    assessment: ViewAssessment | None = Field(None, description="How well the C-arm looks along the holes.")
    off_centre_mm: OffCentre | None = None


class RegistrationEpoch(Message):
    """Names the newest state of registration, and confirms it: published at every change, and five times a second.

    A `LocalisationRecord` reports a new image only once it has been localised, seconds later. Until then no plan from
    the image before may move anything, nor when the newest state is no longer confirmed.
    """

    schema_name: Literal["distalock/registration-epoch/1"] = Field("distalock/registration-epoch/1", alias="schema")
    boot_epoch: Identifier = Field(description="Names this run of registration.")
    sequence: int = Field(ge=0)
    registration_epoch: Identifier


class PlanRequest(Message):
    """Asks registration for the move that makes guide and nail axes coincide, from its newest accepted localisation.

    `image_sha256` names the localisation: planning from any other than the newest is refused as stale.
    """

    schema_name: Literal["distalock/plan-request/1"] = Field("distalock/plan-request/1", alias="schema")
    case_id: Identifier
    image_sha256: Sha256
    hole_ids: tuple[str, ...] = Field(min_length=1)
    earlier_image_sha256: tuple[Sha256, ...] = Field(
        (), description="Earlier images of the same set-up to fuse with it, in the order in which they were taken."
    )
    verified_image_sha256: tuple[Sha256, ...] = Field(
        (), description="Images verified last, this one among them: the wires' axes are brought onto the nail's."
    )


class PredictedHoleError(MessageModel):
    """What remains at one hole after the planned move: its bias (unequal spacings) and standard uncertainty."""

    id: str
    offset_mm: Finite
    angle_deg: Finite
    standard_uncertainty: StandardUncertainty
    chance_to_pass: Probability


class Plan(Message):
    """A move of the hexapod, ready for approval. Its hash names exactly this content."""

    schema_name: Literal["distalock/plan/1"] = Field("distalock/plan/1", alias="schema")
    case_id: Identifier
    case_revision: int = Field(ge=0)
    image_sha256: Sha256
    registration_epoch: Identifier
    robot_boot_epoch: Identifier
    hexapod_sha256: Sha256
    hole_ids: tuple[str, ...]
    head_extension_mm: Finite
    guide_from_target_guide: Matrix4
    start_pose: PlatformPoseMessage
    target_pose: PlatformPoseMessage
    pivot_mm: Vector3
    target_leg_lengths_mm: tuple[Finite, Finite, Finite, Finite, Finite, Finite]
    travel_mm: Finite
    travel_deg: Finite
    axial_shift_mm: Finite = Field(description="Free travel along the drilling axis that was used to stay in reach.")
    predicted: tuple[PredictedHoleError, ...]
    fusion: Fusion | None = Field(None, description="What it rests on when that is more than one image.")
    verified_image_sha256: tuple[Sha256, ...] = Field(
        (), description="Images of the verification whose residual it corrects; empty for a plan from localisations."
    )
    image_age_s: ImageAge = Field(None, description=f"{IMAGE_AGE} Of several images, of the oldest.")

    def sha256(self) -> str:
        """Hash of the plan's canonical JSON: what an approval quotes."""
        return hashlib.sha256(encode(self)).hexdigest()


class PlanReply(Message):
    """A plan, or why there is none."""

    schema_name: Literal["distalock/plan-reply/1"] = Field("distalock/plan-reply/1", alias="schema")
    verdict: Verdict
    code: str = Field(
        "", description="Stable code of the refusal: stale, no_localisation, out_of_reach, unknown_hole, ..."
    )
    message: str = ""
    plan: Plan | None = None


class VerificationRequest(Message):
    """Asks registration to compare the K-wires in one image or two, or the guide's own holes, with the nail's axes."""

    schema_name: Literal["distalock/verification-request/1"] = Field("distalock/verification-request/1", alias="schema")
    case_id: Identifier
    image_sha256: tuple[Sha256, ...] = Field(min_length=1, max_length=2)
    of: VerificationOf = "wires"


class VerifiedWire(MessageModel):
    """One wire's axis against the axis of the nail hole of the same id."""

    id: str
    entry_offset_mm: Finite
    exit_offset_mm: Finite
    angle_deg: Finite
    standard_uncertainty: StandardUncertainty
    chance_to_pass: Probability


class VerifiedGuideHole(MessageModel):
    """The guide hole's own axis against the nail hole's, from the same images: what a drill will follow."""

    id: str
    entry_offset_mm: Finite
    exit_offset_mm: Finite
    angle_deg: Finite
    standard_uncertainty: StandardUncertainty
    chance_to_pass: Probability


class Verification(Message):
    """What `distalock verify` prints."""

    schema_name: Literal["distalock/verification/1"] = Field("distalock/verification/1", alias="schema")
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...]
    images: tuple[Sha256, ...]
    wires: tuple[VerifiedWire, ...]
    guide_holes: tuple[VerifiedGuideHole, ...] = ()
    of: VerificationOf = Field(
        "wires", description="What was to be verified: wires, or the guide alone.", exclude_if=lambda of: of == "wires"
    )
    notes: tuple[str, ...] = Field(
        (), description="Header values that were ignored, and nominal values that were assumed.", exclude_if=is_empty
    )


class VerificationReply(Message):
    """A verification, or why there is none (unknown image, no case, ...)."""

    schema_name: Literal["distalock/verification-reply/1"] = Field("distalock/verification-reply/1", alias="schema")
    code: str = ""
    message: str = ""
    verification: Verification | None = None
