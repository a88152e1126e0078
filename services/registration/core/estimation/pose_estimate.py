"""A pose with its errors, sorted by what shares them with other estimates.

An error is a small motion of the moving frame (see `Transform.exp`), rotation (rad) before translation (mm), shape
(6,): the true transform is ``mean @ Transform.exp(error)``. Sorting matters as soon as a body is observed several
times: noise averages out, the body's shape is the same in all images, and the model's own errors mostly are.
"""

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from services.registration.core.tuning import MODEL_ERRORS
from shared.geometry.frames import Camera, Frame, Nail
from shared.geometry.lines import read_only, unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

To = TypeVar("To", bound=Frame)
From = TypeVar("From", bound=Frame)
Other = TypeVar("Other", bound=Frame)

# A rigid motion's degrees of freedom.
POSE_SIZE = 6


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Covariance of a pose and the factors that its errors share with those of other estimates.

    The nail's shape is described by how far radii, chamfers and curvature are from what its file states, each in
    standard deviations of its prior. A fit estimates these `S` deviations with the pose, and errs in both together:
    holes wider than estimated have tilted the nail.
    """

    shape_deviations: NDArray[np.float64]  # as estimated, shape (S,)
    # Of the errors that come with the image, in the pose and then in the shape, shape (6 + S, 6 + S): the nail's fit
    # to its pixels and, where the pose is relative to the guide, the guide's balls and the C-arm's calibration. Part
    # is noise; the rest (bone texture, which ball lies on which edge) is the same in every image from the same
    # direction.
    image_covariance: NDArray[np.float64]
    # By how much pose and shape are off per deviation of the true shape, shape (6 + S, S): the prior draws a fit
    # towards the nail of the file
    shape_pull: NDArray[np.float64]
    # The model's own errors in pose and shape, one standard deviation each, as columns, shape (6 + S, M): partly
    # common to all images
    model_loadings: NDArray[np.float64]
    # Unit direction in which the body was observed, in its own frame, shape (3,); None where the errors do not depend
    # on it
    ray: NDArray[np.float64] | None = None
    # The last two deviations of the shape are curvatures towards y and z; one deviation is so many 1/m. Zero where the
    # shape holds no curvature.
    bend_sd_per_m: float = 0.0

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
        if self.ray is not None:
            object.__setattr__(self, "ray", read_only(self.ray))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of the pose by all of its errors, shape (6, 6)."""
        by_shape = self.shape_pull[:POSE_SIZE]
        return np.asarray(self.own_covariance[:POSE_SIZE, :POSE_SIZE] + by_shape @ by_shape.T)

    @property
    def own_covariance(self) -> NDArray[np.float64]:
        """Of pose and shape by all but the true shape's pull, shape (6 + S, 6 + S)."""
        return np.asarray(self.image_covariance + self.model_loadings @ self.model_loadings.T)

    def with_image_errors_times(self, rotation: float, translation: float, shape: float) -> "PoseErrors":
        """With errors that come with the image larger by these factors."""
        factors = np.full(len(self.image_covariance), shape)
        factors[:3], factors[3:POSE_SIZE] = rotation, translation
        return replace(self, image_covariance=factors[:, None] * self.image_covariance * factors)

    @property
    def curvature_per_m(self) -> NDArray[np.float64]:
        """Estimated curvature towards y and z, shape (2,)."""
        return self.bend_sd_per_m * self.shape_deviations[-2:] if self.bend_sd_per_m > 0.0 else np.zeros(2)

    @property
    def bend_covariance(self) -> NDArray[np.float64]:
        """Of the curvature by all but the true shape's pull, in 1/m², shape (2, 2)."""
        return np.asarray(self.bend_sd_per_m**2 * self.own_covariance[-2:, -2:])

    @property
    def covariance_with_bend(self) -> NDArray[np.float64]:
        """Of the pose and the curvature (1/m) by all errors, shape (8, 8)."""
        return with_bend(self.own_covariance + self.shape_pull @ self.shape_pull.T, self.bend_sd_per_m)

    def with_held_curvature(self, sd_per_m: float, by_curvature: NDArray[np.float64]) -> "PoseErrors":
        """With two more deviations of the shape that the fit held at zero.

        Parameters
        ----------
        sd_per_m
            Standard deviation of the true curvature.
        by_curvature
            By how much a true curvature of 1/m moves the estimate of pose and shape, shape (6 + S, 2).
        """
        size = len(by_curvature)
        return replace(
            self,
            shape_deviations=np.concatenate([self.shape_deviations, np.zeros(2)]),
            image_covariance=np.pad(self.image_covariance, (0, 2)),
            shape_pull=np.block([[self.shape_pull, -sd_per_m * by_curvature], [np.zeros((2, size - 6)), np.eye(2)]]),
            model_loadings=np.pad(self.model_loadings, (0, 2)),
            bend_sd_per_m=sd_per_m,
        )

    def with_bend_in(self, sd_per_m: float) -> "PoseErrors":
        """The same with the curvature in other deviations."""
        if sd_per_m == self.bend_sd_per_m:
            return self
        scale = np.ones(len(self.image_covariance))
        scale[-2:] = self.bend_sd_per_m / sd_per_m
        of_shape = scale[POSE_SIZE:]
        return replace(
            self,
            shape_deviations=of_shape * self.shape_deviations,
            image_covariance=scale[:, None] * self.image_covariance * scale,
            shape_pull=scale[:, None] * self.shape_pull / of_shape,
            model_loadings=scale[:, None] * self.model_loadings,
            bend_sd_per_m=sd_per_m,
        )

    def with_alternative(self, motion: NDArray[np.float64], curvature_per_m: NDArray[np.float64]) -> "PoseErrors":
        """With another estimate, so far away in pose, shape (6,), and curvature, (2,), as one standard deviation."""
        away = np.zeros(len(self.image_covariance))
        away[:POSE_SIZE], away[-2:] = motion, curvature_per_m / self.bend_sd_per_m
        return replace(self, image_covariance=self.image_covariance + np.outer(away, away))

    def with_more(self, covariance: NDArray[np.float64]) -> "PoseErrors":
        """With further errors of the pose that come with the image, shape (6, 6)."""
        total = self.image_covariance.copy()
        total[:POSE_SIZE, :POSE_SIZE] += covariance
        return replace(self, image_covariance=total)


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate(Generic[To, From]):
    """An estimated transform with its errors; products and inverses carry the errors along, to first order."""

    mean: Transform[To, From]
    errors: PoseErrors

    @staticmethod
    def of(mean: Transform[To, From], covariance: NDArray[np.float64]) -> "PoseEstimate[To, From]":
        """Estimate whose errors, shape (6, 6), no other estimate shares."""
        none = np.zeros((POSE_SIZE, 0))
        return PoseEstimate(mean, PoseErrors(np.zeros(0), covariance, none, none))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of a small motion of `From` in its own frame by all errors, shape (6, 6)."""
        return self.errors.covariance

    def inverse(self) -> "PoseEstimate[From, To]":
        """The inverse transform; what its errors share with other estimates is not kept."""
        adjoint = self.mean.adjoint
        return PoseEstimate.of(self.mean.inverse(), adjoint @ self.covariance @ adjoint.T)

    def __matmul__(self, other: "PoseEstimate[From, Other]") -> "PoseEstimate[To, Other]":
        """Chain with an estimate that shares no error with this one; the right one's shared factors are kept."""
        transport = other.mean.inverse().adjoint
        transported = transport @ self.covariance @ transport.T
        return PoseEstimate(self.mean @ other.mean, other.errors.with_more(transported))


def with_bend(covariance: NDArray[np.float64], bend_sd_per_m: float) -> NDArray[np.float64]:
    """Of pose and shape, shape (6 + S, 6 + S), that of the pose and the curvature (1/m), shape (8, 8)."""
    size = POSE_SIZE + 2
    if bend_sd_per_m == 0.0:
        return np.pad(covariance[:POSE_SIZE, :POSE_SIZE], (0, 2))
    rows = [*range(POSE_SIZE), len(covariance) - 2, len(covariance) - 1]
    scale = np.ones(size)
    scale[POSE_SIZE:] = bend_sd_per_m
    return np.asarray(scale[:, None] * covariance[np.ix_(rows, rows)] * scale)


def weighted_mean(
    first: PoseEstimate[To, From], second: PoseEstimate[To, From], shared: float
) -> PoseEstimate[To, From]:
    """Mean of two estimates of one pose, weighted as if independent, with its covariance under shared errors.

    Once each is whitened, `shared` is the correlation of their errors.
    """
    gain = np.linalg.solve(first.covariance + second.covariance, first.covariance).T
    rest = np.eye(POSE_SIZE) - gain
    both = shared * np.linalg.cholesky(first.covariance) @ np.linalg.cholesky(second.covariance).T
    crossed = rest @ both @ gain.T
    covariance = rest @ first.covariance @ rest.T + gain @ second.covariance @ gain.T + crossed + crossed.T
    return PoseEstimate.of(first.mean.moved(gain @ first.mean.motion_to(second.mean)), covariance)


@dataclass(frozen=True, slots=True, eq=False)
class Conditioned:
    """Errors given an observation of them."""

    mean: NDArray[np.float64]  # expected errors, shape (N,)
    covariance: NDArray[np.float64]  # what is left uncertain, shape (N, N)
    chi_square: float  # of the observation under the prior


def condition(
    prior: NDArray[np.float64],
    observed: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    noise: NDArray[np.float64],
) -> Conditioned:
    """Condition errors of mean zero and covariance `prior`, (N, N), on ``observed = jacobian @ errors + noise``.

    The shapes are (M,), (M, N) and, for the noise's covariance, (M, M).
    """
    spread = noise + jacobian @ prior @ jacobian.T
    gain = np.linalg.solve(spread, jacobian @ prior).T
    chi_square = float(observed @ np.linalg.solve(spread, observed))
    return Conditioned(gain @ observed, prior - gain @ jacobian @ prior, chi_square)


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


def model_loadings_of_shape(bend_sd_per_m: float) -> NDArray[np.float64]:
    """The same for the nail's shape in deviations of their priors, (5, 5): both radii, chamfers, both curvatures."""
    radius, curvature = MODEL_ERRORS.radius_deviations, MODEL_ERRORS.curvature_per_m / bend_sd_per_m
    return np.diag([radius, radius, 0.0, curvature, curvature])


def ray_to(camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Unit direction of the ray to the nail's origin, in the nail's frame, shape (3,)."""
    return np.asarray(camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm))


def length_that_gives_depth_mm(nail: NailPart) -> float:
    """From hole to hole along the nail, or the nail's width where there is but one hole."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    return max(max(along) - min(along), nail.diameter_mm)
