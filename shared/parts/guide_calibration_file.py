"""What `distalock robot calibrate-guide` prints, `distalock/guide-calibration/1`: how a head really holds the guide."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared.errors import PartFileInvalid
from shared.geometry.transform import Transform
from shared.parts.files import Finite, PartModel, parse_part

Real = Annotated[float, Field(allow_inf_nan=False)]
Row4 = tuple[Finite, Finite, Finite, Finite]
Row6 = tuple[Real, Real, Real, Real, Real, Real]
Sha256Text = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class GuideReason(PartModel):
    """Why the images were not good enough, or what is wrong with the head."""

    code: str
    message: str


class GuideUncertainty(PartModel):
    """Predicted rms errors of `top_from_guide`."""

    translation_mm: Real
    rotation_deg: Real


class CheckPose(PartModel):
    """How far the guide was from where the calibration puts it, in an image that the calibration does not rest on."""

    distance_mm: Real
    angle_deg: Real


class HeadSetting(PartModel):
    """The head as measured: along its scale, the guide's turn against its file, and what the scale does not explain."""

    extension_mm: Real
    turned_deg: Real
    beside_mm: Real


class GuideCalibrationFile(PartModel):
    """A guide calibration.

    Attributes
    ----------
    hexapod_sha256, guide_sha256
        Of the files it was made with.
    head_extension_mm
        As read off the scale when the images were taken: `top_from_guide` holds for this setting.
    covariance
        Of a small rotation (rad) and translation (mm) in the guide's own frame, 6 x 6.
    """

    schema_name: Literal["distalock/guide-calibration/1"] = Field("distalock/guide-calibration/1", alias="schema")
    verdict: Literal["accepted", "rejected"]
    reasons: tuple[GuideReason, ...]
    hexapod_sha256: Sha256Text
    guide_sha256: Sha256Text
    head_extension_mm: Real
    top_from_guide: tuple[Row4, Row4, Row4, Row4]
    standard_uncertainty: GuideUncertainty
    covariance: tuple[Row6, Row6, Row6, Row6, Row6, Row6]
    normalised_rms: Real
    check: CheckPose
    head: HeadSetting

    def matrix(self) -> NDArray[np.float64]:
        """`top_from_guide`, shape (4, 4), as it stands there; raises `PartFileInvalid` when it is not a rigid one."""
        matrix = np.array(self.top_from_guide)
        try:
            Transform.from_matrix(matrix)
        except ValueError as error:
            raise PartFileInvalid(f"guide calibration: top_from_guide: {error}") from None
        return matrix


def guide_calibration_from_json(content: bytes, source: str = "guide calibration") -> GuideCalibrationFile:
    """Read what `calibrate-guide` printed; raises `PartFileInvalid`."""
    return parse_part(GuideCalibrationFile, content, source)
