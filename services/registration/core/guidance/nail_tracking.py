"""The nail in a frame of running fluoroscopy, from its predicted pose: the last stage of the fit alone.

An image that was localised in full is the reference: it gives the nail's pose in the guide's frame and the nail's
appearance (radii, attenuation, display curve). As long as neither guide nor nail moves, the guide of a later frame
predicts the nail's pose; the likelihood of `nail.fit`, on coarser pixels, refines pose and blur. What the reference
leaves open, because it is correlated with the tilt, is added to every later covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import HoleView
from services.registration.core.estimation.pose_estimate import POSE_SIZE, PoseEstimate, model_covariance
from services.registration.core.nail.covariance import pose_covariance
from services.registration.core.nail.evidence import hole_views, residual_statistics
from services.registration.core.nail.forward_model import model_at
from services.registration.core.nail.least_squares import (
    Problem,
    Solution,
    estimate_noise,
    evenly_weighted,
    minimise,
    minimise_from,
    problem_for,
    reweighted,
    with_derivatives,
)
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.parameters import (
    CURVATURE,
    PARAMETER_COUNT,
    POSE_ONLY,
    STRAIGHT_NAIL,
    TILTS,
    Parameter,
    curvature_of,
    motion_by_parameters,
    prior_mean,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import NAIL_TRACKING, TILT_SEARCH_STAGE
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.transform import Transform

_FITTED = POSE_ONLY | (np.arange(PARAMETER_COUNT) == Parameter.LOG_BLUR_PX)


@dataclass(frozen=True, slots=True, eq=False)
class NailAppearance:
    """How the C-arm shows the nail, by the reference image."""

    # All unknowns of its fit, shape (PARAMETER_COUNT,); those of the pose belong to that image alone
    parameters: NDArray[np.float64]
    # Of the pose's parameters, shape (6, 6): by the other unknowns, the same in every frame
    shared_covariance: NDArray[np.float64]
    weight: float  # median weight of a pixel: inverse variance over the number of correlated pixels
    blur_px: float  # standard deviation of the blur, in image pixels

    @property
    def curvature_per_m(self) -> tuple[float, float]:
        """Of the nail in the reference image."""
        return curvature_of(self.parameters)


@dataclass(frozen=True, slots=True, eq=False)
class TrackedNail:
    """The nail in this frame, with the evidence for and against it."""

    pose: PoseEstimate[Camera, Nail]
    blur_px: float  # standard deviation of the blur, in image pixels
    holes: tuple[HoleView, ...]
    structure: float  # residual at rims and edges over that elsewhere
    unexplained: float  # share of the pixels whose residual is beyond four standard deviations of the noise
    # Of the fit, for `mirror_margin`
    problem: Problem
    solution: Solution
    noise: NoiseModel


def estimate_appearance(given: FitInput, camera_from_nail: Transform[Camera, Nail]) -> NailAppearance | None:
    """Fit everything once in an image whose nail is known; `None` when its holes are not in the image."""
    stage = NAIL_TRACKING
    model = model_at(given, camera_from_nail, stage, _reduction(given, camera_from_nail))
    if model is None:
        return None
    problem = problem_for(model, stage, STRAIGHT_NAIL)
    start = model.with_pose(prior_mean(), camera_from_nail)
    start[CURVATURE] = given.nail.curvature_per_m
    first = minimise(problem, start, stage.first_steps, stage.first_tolerance)
    problem = reweighted(problem, first.linear, estimate_noise(problem, first.linear))
    solution = with_derivatives(
        problem, minimise_from(problem, first.linear, stage.reference_steps, stage.last_tolerance)
    )
    normal = solution.equations.matrix
    alone = np.linalg.inv(normal[np.ix_(_FITTED, _FITTED)])[:POSE_SIZE, :POSE_SIZE]
    shared = np.linalg.inv(normal)[:POSE_SIZE, :POSE_SIZE] - alone
    blur_px = model.region.sampling.blur_px(solution.parameters)
    return NailAppearance(solution.parameters, shared, float(np.median(problem.weight)), blur_px)


def track_nail(
    given: FitInput, appearance: NailAppearance, predicted: Transform[Camera, Nail]
) -> Accepted[TrackedNail] | Rejected:
    """Refine a predicted pose on the pixels of this frame; `acceptance.frame` decides whether it is accepted."""
    stage = NAIL_TRACKING
    model = model_at(given, predicted, stage, _reduction(given, predicted))
    if model is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    problem = problem_for(model, stage, _FITTED)
    problem = replace(problem, weight=np.full(len(problem.observed), appearance.weight))
    start = model.with_pose(appearance.parameters, predicted)
    solution = minimise(problem, start, stage.first_steps, stage.first_tolerance)
    problem = reweighted(problem, solution.linear, estimate_noise(problem, solution.linear))
    solution = with_derivatives(
        problem, minimise_from(problem, solution.linear, stage.last_steps, stage.last_tolerance)
    )
    noise = estimate_noise(problem, solution.linear)
    residual = residual_statistics(problem, solution, noise)
    beyond = np.abs(solution.linear.residual) > stage.unexplained_sigmas * np.sqrt(noise.variance)
    return Accepted(
        TrackedNail(
            pose=_pose(problem, solution, noise, appearance),
            blur_px=model.region.sampling.blur_px(solution.parameters),
            holes=hole_views(problem, solution),
            structure=residual.structure,
            unexplained=float(np.mean(beyond)),
            problem=problem,
            solution=solution,
            noise=noise,
        )
    )


def mirror_margin(found: TrackedNail) -> float | None:
    """Logarithm of the likelihood ratio to the reflected tilt's optimum; `None` where there is no other optimum.

    Near zero tilt there is no second optimum: the fit from the reflected tilt converges to the same pose.
    """
    start = found.solution.parameters.copy()
    start[TILTS] *= -1.0
    # the weights must not depend on which of both poses was fitted
    problem = evenly_weighted(found.problem, found.noise)
    here = minimise_from(problem, found.solution.linear, NAIL_TRACKING.last_steps, NAIL_TRACKING.first_tolerance)
    reflected = minimise(problem, start, NAIL_TRACKING.reflected_steps, NAIL_TRACKING.first_tolerance)
    apart_rad = angle_between_rad(reflected.hole_direction_camera, found.pose.mean.rotation[:, 2])
    if apart_rad < np.radians(TILT_SEARCH_STAGE.distinct_deg):
        return None
    return 0.5 * (reflected.cost - here.cost)


def _reduction(given: FitInput, pose: Transform[Camera, Nail]) -> int:
    """Reduction after which the smallest hole has the width of a few pixels."""
    px_per_mm = given.calibration.camera.focal_length_px / float(pose.translation_mm[2])
    smallest_px = min(hole.diameter_mm for hole in given.nail.holes) * px_per_mm
    return max(NAIL_TRACKING.least_reduction, round(smallest_px / NAIL_TRACKING.hole_px))


def _pose(
    problem: Problem, solution: Solution, noise: NoiseModel, appearance: NailAppearance
) -> PoseEstimate[Camera, Nail]:
    """With the errors of this frame, of what the reference leaves open, and of the model itself."""
    model = problem.model
    pose = model.pose(solution.parameters)
    jacobian = motion_by_parameters(solution.parameters[:POSE_SIZE], model.camera, model.anchors)
    shared = jacobian @ appearance.shared_covariance @ jacobian.T
    by_model = model_covariance(model.nail, pose)
    return PoseEstimate.of(pose, pose_covariance(problem, solution, noise) + shared + by_model)
