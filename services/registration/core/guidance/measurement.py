"""Guide and nail in a frame of running fluoroscopy, from where they were or are predicted: no search.

Between two frames the guide's shadow hardly turns: one shift puts most of its balls near discs that imaging has
measured, and a few rounds of assignment and fit refine the pose.

An image that was localised in full is the reference: it gives the nail's pose in the guide's frame and the nail's
appearance (radii, attenuation, display curve). As long as neither guide nor nail moves, the guide of a later frame
predicts the nail's pose; the likelihood of `nail.image_fit`, on coarser pixels, refines pose and blur. What the
reference leaves open, because it is correlated with the tilt, is added to every later covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.registration.core.acceptance.criteria import FRAME_GUIDE_BALLS, FRAME_GUIDE_RMS, NAIL_OUTSIDE
from services.registration.core.acceptance.frame import FrameEvidence
from services.registration.core.estimation.image_points import (
    Correspondences,
    down_weighted,
    pose_covariance,
    refine_pose,
    reprojection_rms_px,
)
from services.registration.core.estimation.pose_estimate import POSE_SIZE, PoseEstimate, model_covariance
from services.registration.core.guide.as_built import px_per_mm
from services.registration.core.guide.identity import DiscMap, needed_balls, refined_identity
from services.registration.core.nail.covariance import nail_pose_covariance
from services.registration.core.nail.evidence import hole_views, residual_statistics
from services.registration.core.nail.forward_model import reduced_model
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
    level_tilts,
    prior_mean,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import GUIDE_MEASUREMENT, GUIDE_TRACKING, NAIL_TRACKING, TILT_SEARCH_STAGE
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import GuidePart, across_holes
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels

_FITTED = POSE_ONLY | (np.arange(PARAMETER_COUNT) == Parameter.LOG_BLUR_PX)


def track_guide(
    calibration: CArmCalibration, guide: GuidePart, before: Transform[Camera, Guide]
) -> Accepted[PoseEstimate[Camera, Guide]] | Rejected:
    """Find the guide near where it was in an earlier frame; the errors are those of the balls alone."""
    chosen = _possible_discs(calibration, guide, before)
    ideal_px = calibration.distortion.undistort(calibration.balls.centre_px[chosen])
    needed = needed_balls(len(guide.balls))
    if len(ideal_px) < needed:
        return _lost(len(ideal_px), needed, len(guide.balls))
    balls_mm, camera = guide.balls.position_mm, calibration.camera
    shift_px = _common_shift_px(camera.project(before.points(balls_mm)), ideal_px, calibration.pixel_mm)
    # moved across the beam, so that its image shifts
    by_mm = np.append(shift_px, 0.0) * float(before.translation_mm[2]) / camera.focal_length_px
    start = Transform[Camera, Guide].from_rotation_translation(before.rotation, before.translation_mm + by_mm)
    identity = refined_identity(camera, balls_mm, DiscMap.of(camera, ideal_px, calibration.pixel_mm), start)
    if len(identity) < needed:
        return _lost(len(identity), needed, len(guide.balls))
    disc = chosen[identity.disc_index]
    place_px = px_per_mm(camera, start, balls_mm) * guide.balls.position_sd_mm
    own_px = np.hypot(calibration.balls.standard_deviation_px[disc], GUIDE_MEASUREMENT.systematic_sd_px)
    deviation = np.hypot(own_px, place_px[identity.ball_index])
    seen = Correspondences(balls_mm[identity.ball_index], ideal_px[identity.disc_index], deviation)
    return _accepted(calibration, guide, refine_pose(camera, identity.camera_from_guide, seen), seen)


def _accepted(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide], seen: Correspondences
) -> Accepted[PoseEstimate[Camera, Guide]] | Rejected:
    rms_px = reprojection_rms_px(calibration.camera, pose, seen)
    if not FRAME_GUIDE_RMS.is_met(rms_px):
        observation = (
            f"{len(seen)} of the guide's {len(guide.balls)} balls lie {FRAME_GUIDE_RMS.quoted(rms_px)} from where the "
            "guide's pose predicts them: it or the patient moves"
        )
        return Rejected((FRAME_GUIDE_RMS.reason(observation),))
    weighed = down_weighted(calibration.camera, pose, seen)
    return Accepted(PoseEstimate.of(pose, pose_covariance(calibration.camera, pose, weighed)))


def _possible_discs(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide]
) -> NDArray[np.int64]:
    """Indices of the discs that are not the ring's, of the size that the guide's balls have at this depth."""
    balls = calibration.balls
    radius_px = 0.5 * guide.balls.diameter_mm * calibration.camera.focal_length_px / pose.translation_mm[2]
    smallest = GUIDE_TRACKING.least_radius * radius_px.min()
    largest = GUIDE_TRACKING.greatest_radius * radius_px.max()
    possible = (balls.radius_px > smallest) & (balls.radius_px < largest) & (balls.ring_index == NOT_OF_THE_RING)
    return np.flatnonzero(possible).astype(np.int64)


def _common_shift_px(
    predicted_px: NDArray[np.float64], detected_px: NDArray[np.float64], pixel_mm: float
) -> NDArray[np.float64]:
    """The shift, shape (2,), that most pairs of a predicted and a detected place have in common."""
    shifts = (detected_px[None] - predicted_px[:, None]).reshape(-1, 2)
    shifts = shifts[np.linalg.norm(shifts, axis=1) < pixels(GUIDE_TRACKING.largest_shift_detector_mm, pixel_mm)]
    if len(shifts) == 0:
        return np.zeros(2)
    near = cKDTree(shifts).query_ball_point(shifts, pixels(GUIDE_TRACKING.same_shift_detector_mm, pixel_mm))
    best = max(near, key=len)
    return np.asarray(np.median(shifts[best], axis=0))


def _lost(found: int, needed: int, expected: int) -> Rejected:
    observation = (
        f"of the guide's {expected} balls {FRAME_GUIDE_BALLS.quoted(found, needed)} were found near where the last "
        "frame showed them: the view has jumped, or the guide is covered"
    )
    return Rejected((FRAME_GUIDE_BALLS.reason(observation),))


@dataclass(frozen=True, slots=True, eq=False)
class NailAppearance:
    """How the C-arm shows the nail, by the reference image."""

    # All unknowns of its fit, shape (PARAMETER_COUNT,); those of the pose belong to that image alone
    parameters: NDArray[np.float64]
    # Of the pose's parameters, shape (6, 6): by the other unknowns, the same in every frame
    shared_covariance: NDArray[np.float64]
    weight: float  # median weight of a pixel: inverse variance over the number of correlated pixels
    blur_px: float  # standard deviation of the blur, in image pixels


@dataclass(frozen=True, slots=True, eq=False)
class TrackedNail:
    """The nail in this frame, and the fit that found it."""

    pose: PoseEstimate[Camera, Nail]
    problem: Problem
    solution: Solution
    noise: NoiseModel


def estimate_appearance(given: FitInput, camera_from_nail: Transform[Camera, Nail]) -> NailAppearance | None:
    """Fit everything once in an image whose nail is known; `None` when its holes are not in the image."""
    model = reduced_model(given, camera_from_nail, NAIL_TRACKING, NAIL_TRACKING.hole_px)
    if model is None:
        return None
    start = model.with_pose(prior_mean(), camera_from_nail)
    start[CURVATURE] = given.nail.curvature_per_m
    problem = problem_for(model, NAIL_TRACKING, STRAIGHT_NAIL)
    problem, solution = _fitted(problem, start, NAIL_TRACKING.reference_steps)
    normal = solution.equations.matrix
    alone = np.linalg.inv(normal[np.ix_(_FITTED, _FITTED)])[:POSE_SIZE, :POSE_SIZE]
    shared = np.linalg.inv(normal)[:POSE_SIZE, :POSE_SIZE] - alone
    blur_px = model.region.sampling.blur_px(solution.parameters)
    return NailAppearance(solution.parameters, shared, float(np.median(problem.weight)), blur_px)


def track_nail(
    given: FitInput, appearance: NailAppearance, predicted: Transform[Camera, Nail]
) -> Accepted[TrackedNail] | Rejected:
    """Refine a predicted pose on the pixels of this frame; `acceptance.frame` decides whether it is accepted."""
    model = reduced_model(given, predicted, NAIL_TRACKING, NAIL_TRACKING.hole_px)
    if model is None:
        return Rejected((NAIL_OUTSIDE.reason(remedy="keep the holes inside the image"),))
    problem = problem_for(model, NAIL_TRACKING, _FITTED)
    problem = replace(problem, weight=np.full(len(problem.observed), appearance.weight))
    start = model.with_pose(appearance.parameters, predicted)
    problem, solution = _fitted(problem, start, NAIL_TRACKING.last_steps)
    noise = estimate_noise(problem, solution.linear)
    return Accepted(TrackedNail(_pose(problem, solution, noise, appearance), problem, solution, noise))


def frame_evidence(
    nail: TrackedNail, appearance: NailAppearance, predicted: PoseEstimate[Camera, Nail]
) -> FrameEvidence:
    """The observed nail, and how far it lies from where guide and reference predict it."""
    apart = predicted.mean.inverse() @ nail.pose.mean
    across = across_holes(nail.problem.model.nail)
    tilts = across @ nail.pose.covariance[:3, :3] @ across.T
    rotation = tilts + across @ predicted.covariance[:3, :3] @ across.T
    unexplained = NAIL_TRACKING.unexplained_sigmas * np.sqrt(nail.noise.variance)
    return FrameEvidence(
        holes=hole_views(nail.problem, nail.solution),
        structure=residual_statistics(nail.problem, nail.solution, nail.noise).structure,
        unexplained=float(np.mean(np.abs(nail.solution.linear.residual) > unexplained)),
        turned_deg=tuple(np.degrees(across @ apart.rotation_vector_rad).tolist()),
        turn_sd_deg=tuple(np.degrees(np.sqrt(np.diag(rotation))).tolist()),
        across_mm=float(np.linalg.norm(across @ apart.translation_mm)),
        blur_px=nail.problem.model.region.sampling.blur_px(nail.solution.parameters),
        reference_blur_px=appearance.blur_px,
        tilt_sd_deg=float(np.degrees(np.sqrt(np.diag(tilts).max()))),
    )


def mirror_margin(found: TrackedNail) -> float | None:
    """Logarithm of the likelihood ratio to the reflected tilt's optimum; `None` where there is no other optimum.

    Near zero tilt there is no second optimum: the fit from the reflected tilt converges to the same pose.
    """
    start = found.solution.parameters.copy()
    start[TILTS] = 2.0 * level_tilts(found.problem.model.nail) - start[TILTS]
    # the weights must not depend on which of both poses was fitted
    problem = evenly_weighted(found.problem, found.noise)
    here = minimise_from(problem, found.solution.linear, NAIL_TRACKING.last_steps, NAIL_TRACKING.first_tolerance)
    reflected = minimise(problem, start, NAIL_TRACKING.reflected_steps, NAIL_TRACKING.first_tolerance)
    apart_rad = angle_between_rad(reflected.hole_direction_camera, found.solution.hole_direction_camera)
    if apart_rad < np.radians(TILT_SEARCH_STAGE.distinct_deg):
        return None
    return 0.5 * (reflected.cost - here.cost)


def _fitted(problem: Problem, start: NDArray[np.float64], last_steps: int) -> tuple[Problem, Solution]:
    """Minimised twice: with the weights of the problem, then with those by the noise that the first fit leaves."""
    stage = NAIL_TRACKING
    first = minimise(problem, start, stage.first_steps, stage.first_tolerance).linear
    problem = reweighted(problem, first, estimate_noise(problem, first))
    return problem, with_derivatives(problem, minimise_from(problem, first, last_steps, stage.last_tolerance))


def _pose(
    problem: Problem, solution: Solution, noise: NoiseModel, appearance: NailAppearance
) -> PoseEstimate[Camera, Nail]:
    """With the errors of this frame, of what the reference leaves open, and of the model itself."""
    model = problem.model
    pose = model.pose(solution.parameters)
    jacobian = model.motion_by_parameters(solution.parameters)
    shared = jacobian @ appearance.shared_covariance @ jacobian.T
    by_model = model_covariance(model.nail, pose)
    return PoseEstimate.of(pose, nail_pose_covariance(problem, solution, noise) + shared + by_model)
