"""What `distalock calibrate` prints, `distalock/part-calibration/1`, and the measured part file that it writes."""

import json
from typing import Annotated, Literal

from pydantic import Field

from distalock.part_calibration.displacements import Array
from shared.parts.files import PartModel

Real = Annotated[float, Field(allow_inf_nan=False)]
_DECIMALS = 4
# The least tolerance that a file may state; a smaller one would be beyond what images measure.
_LEAST_TOLERANCE_MM = 0.001


class CalibrationImage(PartModel):
    """One image: `fitted` to the balls, `held_out` to check them, or `left_out` with the reason.

    Attributes
    ----------
    rms_before_px, rms_after_px
        Residual of the balls with the file's places and with the measured ones.
    """

    image_file: str
    role: Literal["fitted", "held_out", "left_out"]
    why: str = ""
    rms_before_px: Real | None = None
    rms_after_px: Real | None = None


class MeasuredBall(PartModel):
    """One ball: its displacement from the file along x, y and z, and the covariance of that, in mm and mm²."""

    id: str
    images: int
    displacement_mm: tuple[Real, Real, Real]
    covariance_mm2: tuple[tuple[Real, Real, Real], tuple[Real, Real, Real], tuple[Real, Real, Real]]
    outlier: bool


class PartCalibration(PartModel):
    """The calibration of a built part.

    Attributes
    ----------
    spread_mm
        Standard deviation of the balls' displacements along each axis: how well the part was built.
    frame_mm, frame_deg
        Standard deviations of the place and direction of all balls together against the file's frame, which no image
        shows; null for a ring, whose frame nothing else refers to.
    held_out_rms_before_px, held_out_rms_after_px
        Residuals in images that the displacements were not fitted to.
    outliers
        Ids of balls displaced by more than four times the spread of the others.
    """

    schema_name: Literal["distalock/part-calibration/1"] = Field("distalock/part-calibration/1", alias="schema")
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[str, ...]
    part: Literal["ring", "guide"]
    part_sha256: str
    spread_mm: Real
    frame_mm: Real | None
    frame_deg: Real | None
    held_out_rms_before_px: Real
    held_out_rms_after_px: Real
    outliers: tuple[str, ...]
    images: tuple[CalibrationImage, ...]
    balls: tuple[MeasuredBall, ...]


def measured_file(filed: bytes, displacement_mm: Array, sd_mm: Array, frame: tuple[float, float] | None) -> bytes:
    """The part file with measured places, shape (B, 3), and what is left as tolerance of each ball, shape (B,).

    `frame` is how far the balls together may be off the file's frame, in mm and degrees; None for a ring.
    """
    part = json.loads(filed)
    for ball, moved, sd in zip(part["balls"], displacement_mm, sd_mm, strict=True):
        ball["position_mm"] = [round(float(p + d), _DECIMALS) for p, d in zip(ball["position_mm"], moved, strict=True)]
        ball["tolerance_mm"] = round(max(float(sd), _LEAST_TOLERANCE_MM), _DECIMALS)
    if frame is not None:
        part["frame_tolerance_mm"] = round(max(frame[0], _LEAST_TOLERANCE_MM), _DECIMALS)
        part["frame_tolerance_deg"] = round(max(frame[1], _LEAST_TOLERANCE_MM), _DECIMALS)
    return (json.dumps(part, indent=1) + "\n").encode()
