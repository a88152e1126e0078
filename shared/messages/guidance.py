"""What registration says of every frame while the C-arm is turned: how the holes are tilted, or why it cannot tell."""

from typing import Annotated, Literal

from pydantic import Field

from shared.messages.base import Finite, Identifier, Message, MessageModel, ReasonMessage, Verdict
from shared.messages.imaging import ImageAge, ImageReference
from shared.messages.registration import IMAGE_AGE, CArmCorrection, OffCentre, ViewAssessment

GuidanceOrigin = Literal["localised", "followed"]
Degrees = Annotated[float, Field(allow_inf_nan=False, ge=0.0)]


class GuidedHole(MessageModel):
    """Tilt of one hole's axis against the ray through it, in degrees.

    `about_image_x` and `about_image_y` turn the ray to the axis, about the camera frame's axes, right-handed.
    """

    id: str
    tilt_to_ray_deg: Finite
    about_image_x: Finite
    about_image_y: Finite


class GuidanceUncertainty(MessageModel):
    """Standard deviation of every tilt and of the correction, in degrees: the holes are in one piece of metal."""

    about_image_x: Degrees
    about_image_y: Degrees


class PositionerTurn(MessageModel):
    """The correction in the C-arm's own angles: how far to turn each, and where they are then, in degrees."""

    orbital: Finite
    angular: Finite
    orbital_then: Finite
    angular_then: Finite


class PositionerShift(MessageModel):
    """Shift of the C-arm that centres the holes, for a patient on the back: along the table, across it, up; in mm."""

    towards_head: Finite
    to_patients_right: Finite
    up: Finite


class MirrorCheck(MessageModel):
    """Confidence in the tilt's sign, and in which frame, counted back from this one, it was measured.

    `log_likelihood_ratio` is None where the frame has no second optimum, as near zero tilt.
    """

    log_likelihood_ratio: Finite | None
    frames_ago: int = Field(ge=0)


class Guidance(Message):
    """One frame's word. On rejection it says why, and nothing of an earlier frame stands in for it.

    Attributes
    ----------
    origin
        Whether the frame was localised in full, or followed from one that was.
    skipped
        Frames since the last word that were passed over because newer ones had come.
    elapsed_ms
        What this frame took here, without its calibration.
    """

    schema_name: Literal["distalock/guidance/1"] = Field("distalock/guidance/1", alias="schema")
    verdict: Verdict
    reasons: tuple[ReasonMessage, ...]
    origin: GuidanceOrigin
    image: ImageReference
    case_id: Identifier | None
    case_revision: int = Field(ge=0)
    holes: tuple[GuidedHole, ...] | None
    c_arm_correction_deg: CArmCorrection | None
    positioner_turn_deg: PositionerTurn | None
    standard_uncertainty_deg: GuidanceUncertainty | None
    mirror_check: MirrorCheck | None
    skipped: int = Field(ge=0)
    elapsed_ms: Finite
    image_age_s: ImageAge = Field(None, description=IMAGE_AGE)
    assessment: ViewAssessment | None = Field(None, description="How well the C-arm looks along the holes.")
    off_centre_mm: OffCentre | None = None
    positioner_shift_mm: PositionerShift | None = Field(
        None, description="The same in the C-arm's own axes; null until the display's rotation is known."
    )
