"""Fit the nail's pose to the pixels by maximum likelihood: capture, refine, weigh, judge.

The record `docs/decisions/0009-nail-likelihood.md` has the model, the alternatives and their figures.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.covariance import pose_errors
from services.registration.core.nail.equations import Problem, solution_at
from services.registration.core.nail.judgement import (
    Evidence,
    HoleView,
    ResidualStatistics,
    hole_views,
    nail_outside,
    reasons_against,
    residual_statistics,
)
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.rivals import Winner, find_winner
from services.registration.core.nail.solver import Solution, minimise_from, with_derivatives
from services.registration.core.nail.stages import (
    EVERYTHING,
    Detail,
    Given,
    Noise,
    noise_of,
    problem_for,
    reweighted,
    scene_at,
    whitened,
)
from services.registration.core.nail.unknowns import Unknown
from services.registration.core.nail.window import Scale
from services.registration.core.pose_errors import PoseErrors
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

_FINE = Detail(Scale(1, 0.0), 3.5, 1.5, 0.015)
_FIRST_STEPS, _LAST_STEPS = 5, 4
_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class NailFit:
    """Pose of the nail, how sure it is, and what else the pixels said.

    Attributes
    ----------
    camera_from_nail
        The pose.
    errors
        Of the small motion `m` with true pose = `camera_from_nail @ m`: rotation vector (rad), then translation (mm),
        both in the nail's frame at its origin. Correlated noise, all nuisances and the model's own errors are included;
        calibration's and guide's errors are not.
    mirror_margin
        Logarithm of the likelihood ratio between this pose and the other optimum (at least 1.5° away, in practice the
        reflected tilt), or, when there is no other, the best pose with pitch or roll 3° away. The noise's correlation
        is divided out, so that the ratio is that of as many independent samples. Of a rival that is clearly worse it
        is what it exceeds.
    hole_radius_excess_mm, nail_radius_excess_mm
        Fitted radii less those of the part.
    blur_px
        Standard deviation of the blur that was fitted.
    residual
        Statistics of what the model does not explain.
    holes
        How much of each hole was seen.
    """

    camera_from_nail: Transform[Camera, Nail]
    errors: PoseErrors
    mirror_margin: float
    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    blur_px: float
    residual: ResidualStatistics
    holes: tuple[HoleView, ...]

    def evidence(self, nail: NailPart) -> Evidence:
        """What a verdict rests on."""
        return Evidence(
            nail,
            self.holes,
            self.residual,
            self.hole_radius_excess_mm,
            self.nail_radius_excess_mm,
            self.mirror_margin,
        )


def fit_nail(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    start: Transform[Camera, Nail],
    occluders: Occluders,
) -> Accepted[NailFit] | Rejected:
    """Find where the nail is, from a start within about 5° and 3 mm across, and judge what was found.

    Parameters
    ----------
    pixels
        Grey values of the un-mirrored image, darker is denser, shape (rows, columns).
    start
        First guess of the pose; its tilt may be the reflected one.

    Returns
    -------
    Accepted[NailFit] or Rejected
        Refused as `hole_not_visible`, `nail_model_mismatch` or `mirror_ambiguous`.
    """
    measured = measure_nail(pixels, calibration, nail, start, occluders)
    if isinstance(measured, Rejected):
        return measured
    reasons = reasons_against(measured.value.evidence(nail))
    return Rejected(reasons) if reasons else measured


def measure_nail(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    start: Transform[Camera, Nail],
    occluders: Occluders,
) -> Accepted[NailFit] | Rejected:
    """The same without a verdict; rejected only when the strip around the holes is not in the image."""
    given = Given(pixels, calibration, nail, occluders)
    winner = find_winner(given, start)
    if winner is None:
        return nail_outside(nail)
    scene = scene_at(given, winner.camera_from_nail, _FINE)
    if scene is None:
        return nail_outside(nail)
    problem, solution, noise = _refined(problem_for(scene, _FINE, EVERYTHING), winner)
    return Accepted(
        NailFit(
            scene.pose(solution.parameters),
            pose_errors(problem, solution, noise),
            winner.margin,
            float(solution.parameters[Unknown.HOLE_RADIUS_EXCESS_MM]),
            float(solution.parameters[Unknown.NAIL_RADIUS_EXCESS_MM]),
            float(np.exp(solution.parameters[Unknown.LOG_BLUR_PX])),
            residual_statistics(problem, solution, noise),
            hole_views(problem, solution),
        )
    )


def _refined(problem: Problem, winner: Winner) -> tuple[Problem, Solution, Noise]:
    """Full resolution: learn the noise where the coarser stage ended, filter the noise, fit, weigh, fit."""
    here = solution_at(problem, winner.parameters)
    problem, here = whitened(problem, here, noise_of(problem, here))
    solution = minimise_from(problem, here, _FIRST_STEPS, _TOLERANCE)
    problem = reweighted(problem, solution.linear, noise_of(problem, solution.linear))
    # begun with derivatives from here: those of the first steps may have led along the valley in which radii, curve and
    # tilt nearly make up for one another, and ended in it
    solution = with_derivatives(problem, minimise_from(problem, solution.linear, _LAST_STEPS, _TOLERANCE))
    return problem, solution, noise_of(problem, solution.linear)
