"""What the nail's model itself leaves uncertain in its pose: errors that hardly average out over images."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.tuning import MODEL_ERRORS
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform


def model_covariance(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Covariance of the model's own errors in one image, shape (6, 6)."""
    loadings = model_loadings(nail, camera_from_nail)
    return np.asarray(loadings @ loadings.T)


def model_loadings(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """The model's own errors, one standard deviation each, as columns, shape (6, 6).

    Rotation about the nail's axes, position along x and y, and depth. The depth follows from the distance of the
    outermost holes, or the nail's width where there is but one hole: that distance has the error of the nail's
    position, and depth is to its error as the distance is to its own. An error of depth moves the nail along the ray,
    and so across its holes when they are tilted against it.
    """
    sd = MODEL_ERRORS
    depth_sd_mm = sd.position_mm * float(camera_from_nail.translation_mm[2]) / length_that_gives_depth_mm(nail)
    loadings = np.diag(np.radians([sd.tilt_deg, sd.tilt_deg, sd.turn_about_z_deg, 0.0, 0.0, 0.0]))
    loadings[[3, 4], [3, 4]] = sd.position_mm
    loadings[3:, 5] = depth_sd_mm * ray_to(camera_from_nail)
    return loadings


def model_loadings_of_shape() -> NDArray[np.float64]:
    """The same for the nail's shape: hole radius, nail radius and chamfers, in deviations of their priors, (3, 3)."""
    return np.diag([MODEL_ERRORS.radius_deviations, MODEL_ERRORS.radius_deviations, 0.0])


def ray_to(camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Unit direction of the ray to the nail's origin, in the nail's frame, shape (3,)."""
    return np.asarray(camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm))


def length_that_gives_depth_mm(nail: NailPart) -> float:
    """From hole to hole along the nail, or the nail's width where there is but one hole."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    return max(max(along) - min(along), nail.diameter_mm)
