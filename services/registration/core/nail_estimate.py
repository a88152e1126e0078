"""The nail in the camera's frame, in the form in which all methods that find it hand it on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import PoseErrors
from services.registration.core.nail.fit import NailFit
from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True)
class Misfit:
    """How far the fitted model had to depart from the part, and what it left unexplained.

    Attributes
    ----------
    hole_radius_excess_mm, nail_radius_excess_mm
        Fitted radii less those of the nail's file.
    structure
        Residual at rims and edges over that elsewhere; one when only noise is left.
    """

    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    structure: float


@dataclass(frozen=True, slots=True, eq=False)
class NailEstimate:
    """The nail in the camera's frame, whichever method found it.

    Attributes
    ----------
    camera_from_nail
        Pose of the nail.
    errors
        Of the pose, as small motions in the nail's own frame. None for a method that does not know its errors.
    mirror_margin
        How much worse the best mirrored pose explains the pixels; None for methods without one.
    misfit
        What speaks against the model; None for methods that fit none.
    """

    camera_from_nail: Transform[Camera, Nail]
    errors: PoseErrors | None
    mirror_margin: float | None
    misfit: Misfit | None

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of a small rotation (rad) and translation (mm) in the nail's own frame, as `GuideFit.covariance`."""
        return None if self.errors is None else self.errors.covariance


def fitted_estimate(fit: NailFit) -> NailEstimate:
    """What a fit to the pixels says of the pose."""
    misfit = Misfit(fit.hole_radius_excess_mm, fit.nail_radius_excess_mm, fit.residual.structure)
    return NailEstimate(fit.camera_from_nail, fit.errors, fit.mirror_margin, misfit)
