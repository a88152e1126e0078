"""The nail in a frame of running fluoroscopy, from where the guide says it must be: the last stage of the fit alone.

An image that was localised in full leaves a *key*: where the nail is in the guide's frame, and how the C-arm shows it
(radii, attenuation, curve). As long as neither guide nor nail is moved, the guide of a later frame says where the nail
must be; the same likelihood as in `nail.fit`, on coarser pixels, moves pose and blur from there. What the key could not
tell apart from a tilt stays uncertain and is added to every later covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import HoleView
from services.registration.core.estimation.pose_estimate import POSE_SIZE, model_covariance
from services.registration.core.nail.evidence import hole_views, residual_statistics
from services.registration.core.nail.fit import pose_covariance
from services.registration.core.nail.forward_model import Detail, FitInput, ForwardModel, model_at
from services.registration.core.nail.imaging_chain import Scale
from services.registration.core.nail.least_squares import (
    ALL_PARAMETERS,
    NoiseModel,
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
from services.registration.core.nail.parameters import (
    PARAMETER_COUNT,
    Parameter,
    motion_by_parameters,
    parameters_from_pose,
    prior_mean,
)
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.transform import Transform

_HOLE_PX = 12.0
_SURROUNDINGS_MM, _KNOTS_MM, _TEXTURE, _SMOOTHING = 3.0, 3.0, 0.02, 0.8
_KEY_STEPS, _FIRST_STEPS, _LAST_STEPS, _RIVAL_STEPS = 8, 2, 2, 5
_LOOSE, _TIGHT = 2.0, 0.2
_DISTINCT_RAD = float(np.radians(1.5))
_UNEXPLAINED_DEVIATIONS = 4.0
_POSE = np.arange(PARAMETER_COUNT) < POSE_SIZE
_FOLLOWED = _POSE | (np.arange(PARAMETER_COUNT) == Parameter.LOG_BLUR_PX)
_TILTS = [Parameter.PITCH_RAD, Parameter.ROLL_RAD]


@dataclass(frozen=True, slots=True, eq=False)
class NailAppearance:
    """How the C-arm shows the nail, as the key image said.

    Attributes
    ----------
    parameters
        All unknowns of the fit there, shape (PARAMETER_COUNT,); those of the pose belong to that image alone.
    shared_covariance
        Of the pose's parameters, shape (6, 6): what the other unknowns leave open, the same in every frame.
    weight
        Usual weight of a pixel: inverse variance, shared among as many as err together.
    """

    parameters: NDArray[np.float64]
    shared_covariance: NDArray[np.float64]
    weight: float

    @property
    def blur_px(self) -> float:
        """Standard deviation of the blur."""
        return float(np.exp(self.parameters[Parameter.LOG_BLUR_PX]))


@dataclass(frozen=True, slots=True, eq=False)
class TrackedNail:
    """The nail in this frame, and what speaks for and against it.

    Attributes
    ----------
    camera_from_nail, covariance
        As in `NailEstimate`.
    blur_px
        Of this frame.
    holes
        How much of each hole was seen.
    structure
        Residual at rims and edges over that elsewhere.
    unexplained
        Share of the pixels whose residual is beyond four standard deviations of the noise.
    problem, solution, noise
        What the pose came from, for `mirror_margin`.
    """

    camera_from_nail: Transform[Camera, Nail]
    covariance: NDArray[np.float64]
    blur_px: float
    holes: tuple[HoleView, ...]
    structure: float
    unexplained: float
    problem: Problem
    solution: Solution
    noise: NoiseModel


def estimate_appearance(given: FitInput, camera_from_nail: Transform[Camera, Nail]) -> NailAppearance | None:
    """Fit everything once in an image whose nail is known; `None` when its holes are not in the image."""
    scene = model_at(given, camera_from_nail, _detail(given, camera_from_nail))
    if scene is None:
        return None
    start = _with_pose(prior_mean(), scene, camera_from_nail)
    problem = problem_for(scene, _detail(given, camera_from_nail), ALL_PARAMETERS)
    first = minimise(problem, start, _FIRST_STEPS, _LOOSE)
    problem = reweighted(problem, first.linear, estimate_noise(problem, first.linear))
    solution = with_derivatives(problem, minimise_from(problem, first.linear, _KEY_STEPS, _TIGHT))
    normal = solution.normal_matrix
    alone = np.linalg.inv(normal[np.ix_(_FOLLOWED, _FOLLOWED)])[:POSE_SIZE, :POSE_SIZE]
    shared = np.linalg.inv(normal)[:POSE_SIZE, :POSE_SIZE] - alone
    return NailAppearance(solution.parameters, shared, float(np.median(problem.weight)))


def track_nail(
    given: FitInput, appearance: NailAppearance, predicted: Transform[Camera, Nail]
) -> Accepted[TrackedNail] | Rejected:
    """Refine a predicted pose on the pixels of this frame; judging what came out is the caller's business."""
    detail = _detail(given, predicted)
    scene = model_at(given, predicted, detail)
    if scene is None:
        return Rejected((NAIL_OUTSIDE.reason(),))
    start = _with_pose(appearance.parameters, scene, predicted)
    problem = problem_for(scene, detail, _FOLLOWED)
    problem = replace(problem, weight=np.full(len(problem.grey), appearance.weight))
    solution = minimise(problem, start, _FIRST_STEPS, _LOOSE)
    problem = reweighted(problem, solution.linear, estimate_noise(problem, solution.linear))
    solution = with_derivatives(problem, minimise_from(problem, solution.linear, _LAST_STEPS, _TIGHT))
    noise = estimate_noise(problem, solution.linear)
    residual = residual_statistics(problem, solution, noise)
    beyond = np.abs(solution.linear.residual) > _UNEXPLAINED_DEVIATIONS * np.sqrt(noise.variance)
    pose = scene.pose(solution.parameters)
    return Accepted(
        TrackedNail(
            pose,
            _covariance(given, problem, solution, noise, appearance),
            float(np.exp(solution.parameters[Parameter.LOG_BLUR_PX])),
            hole_views(problem, solution),
            residual.structure,
            float(np.mean(beyond)),
            problem,
            solution,
            noise,
        )
    )


def mirror_margin(found: TrackedNail) -> float | None:
    """Logarithm of the likelihood ratio to the reflected tilt's optimum; `None` where there is no other optimum.

    Near zero tilt an image has no second optimum: the reflection ends where it began.
    """
    start = found.solution.parameters.copy()
    start[_TILTS] *= -1.0
    # no pixel may weigh less because the pose that was found does not explain it
    problem = evenly_weighted(found.problem, found.noise)
    here = minimise_from(problem, found.solution.linear, _LAST_STEPS, _LOOSE)
    rival = minimise(problem, start, _RIVAL_STEPS, _LOOSE)
    z = problem.model.pose(rival.parameters).rotation[:, 2]
    if angle_between_rad(z, found.camera_from_nail.rotation[:, 2]) < _DISTINCT_RAD:
        return None
    return 0.5 * (rival.cost - here.cost)


def _detail(given: FitInput, pose: Transform[Camera, Nail]) -> Detail:
    """Pixels so large that the smallest hole is about twelve of them wide, at least two by two of the image's."""
    px_per_mm = given.calibration.camera.focal_length_px / float(pose.translation_mm[2])
    smallest_px = min(hole.diameter_mm for hole in given.nail.holes) * px_per_mm
    scale = Scale(max(2, round(smallest_px / _HOLE_PX)), _SMOOTHING)
    return Detail(scale, _SURROUNDINGS_MM, _KNOTS_MM, _TEXTURE)


def _with_pose(
    parameters: NDArray[np.float64], scene: ForwardModel, pose: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    start = parameters.copy()
    start[:POSE_SIZE] = parameters_from_pose(pose, scene.camera, scene.anchors)
    return start


def _covariance(
    given: FitInput, problem: Problem, solution: Solution, noise: NoiseModel, appearance: NailAppearance
) -> NDArray[np.float64]:
    """Of pose and blur in this frame, of what the key left open, and of the model's own errors."""
    scene = problem.model
    jacobian = motion_by_parameters(solution.parameters[:POSE_SIZE], scene.camera, scene.anchors)
    shared = jacobian @ appearance.shared_covariance @ jacobian.T
    own = model_covariance(given.nail, scene.pose(solution.parameters))
    return np.asarray(pose_covariance(problem, solution, noise) + shared + own)
