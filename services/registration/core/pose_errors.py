"""Errors of the nail's pose in one image, sorted by what shares them with other images.

An error is a small motion of the nail in its own frame, rotation (rad) before translation (mm), shape (6,). Sorting
matters as soon as there are several images: noise averages out, the nail's shape is the same in all of them, and the
model's own errors mostly are.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.parameters import POSE_SIZE
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import read_only, unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

# What is left of the model's own errors after all that the fit floats: standard deviation of the tilt about the nail's
# x and y axes, of the turn about its z axis, and of its place across the beam, from independent images and own scenes.
MODEL_SD_DEG = 0.04
MODEL_SD_ABOUT_Z_DEG = 0.02
MODEL_SD_MM = 0.007
# The same of what it finds of the nail's radii and chamfers (`SHAPE_PARAMETERS`), in deviations: 6 um of a radius.
MODEL_SD_OF_SHAPE = np.array([0.2, 0.2, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """What leaves the pose uncertain, and with it what the image says of the nail's shape.

    The nail's shape is told by how far radii and chamfers are from what its file says, each in standard deviations of
    what is known of it before an image is seen. A fit finds these deviations with the pose, and errs in both together:
    holes wider than was found have leant the nail. `S` of them are told.

    Attributes
    ----------
    shape_deviations
        As they were found, shape (S,).
    image_covariance
        Of the errors that come with the image, in the pose and then in the shape, shape (6 + S, 6 + S): the nail's fit
        to its pixels and, where the pose is told from the guide, the guide's balls and the C-arm's calibration. Part is
        noise; the rest (bone texture, which ball lies on which edge) is the same in every image from the same
        direction.
    shape_pull
        By how much pose and shape are off per deviation of the true shape, shape (6 + S, S): a fit is drawn towards the
        nail of the file.
    model_loadings
        The model's own errors in pose and shape, one standard deviation each, as columns, shape (6 + S, M): partly
        common to all images.
    """

    shape_deviations: NDArray[np.float64]
    image_covariance: NDArray[np.float64]
    shape_pull: NDArray[np.float64]
    model_loadings: NDArray[np.float64]

    def __post_init__(self) -> None:
        shapes = len(self.shape_deviations)
        size = POSE_SIZE + shapes
        if self.image_covariance.shape != (size, size) or self.shape_pull.shape != (size, shapes):
            raise ValueError(
                f"expected a covariance of shape ({size}, {size}) and a pull of shape ({size}, {shapes}) "
                f"beside {shapes} deviations of the nail's shape, got {self.image_covariance.shape} and "
                f"{self.shape_pull.shape}"
            )
        for name in ("shape_deviations", "image_covariance", "shape_pull", "model_loadings"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of the pose from this image alone, shape (6, 6)."""
        by_shape = self.shape_pull[:POSE_SIZE]
        return np.asarray(self.own_covariance[:POSE_SIZE, :POSE_SIZE] + by_shape @ by_shape.T)

    @property
    def own_covariance(self) -> NDArray[np.float64]:
        """Of pose and shape by all but what the true shape pulls, shape (6 + S, 6 + S)."""
        return np.asarray(self.image_covariance + self.model_loadings @ self.model_loadings.T)

    def with_more(self, image_covariance: NDArray[np.float64]) -> "PoseErrors":
        """With further errors of the pose that come with the image, shape (6, 6)."""
        covariance = self.image_covariance.copy()
        covariance[:POSE_SIZE, :POSE_SIZE] += image_covariance
        return replace(self, image_covariance=covariance)


def model_covariance(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Covariance of the model's own errors in one image, shape (6, 6)."""
    loadings = model_loadings(nail, camera_from_nail)
    return np.asarray(loadings @ loadings.T)


def model_loadings(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """What the model itself leaves uncertain: columns of one standard deviation each, shape (6, 6).

    Rotation about the nail's axes, place along x and y, and depth. The depth follows from the distance of the
    outermost holes, or the nail's width where there is but one hole: that distance is off by as much as the nail's
    place, and depth is to its error as the distance is to its own. An error of depth moves the nail along the ray, and
    so across its holes when they are tilted against it.
    """
    depth_sd_mm = MODEL_SD_MM * float(camera_from_nail.translation_mm[2]) / length_that_tells_depth_mm(nail)
    loadings = np.diag(np.radians([MODEL_SD_DEG, MODEL_SD_DEG, MODEL_SD_ABOUT_Z_DEG, 0.0, 0.0, 0.0]))
    loadings[[3, 4], [3, 4]] = MODEL_SD_MM
    loadings[3:, 5] = depth_sd_mm * (camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm))
    return loadings


def length_that_tells_depth_mm(nail: NailPart) -> float:
    """The length that tells the depth: from hole to hole, or the nail's width where there is but one."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    return max(max(along) - min(along), nail.diameter_mm)
