"""Whether the parts of an image agree about the nail's pose, and how far its covariance grows where they do not.

At the optimum the pulls of all pixels on the pose cancel. Under the noise model the pull of one part, a sector of a
rim or a stretch of an edge, has a known variance. Where the model does not hold, as after local contrast enhancement
or a noise filter, the parts pull against one another by more, and the nuisance parameters leave their usual range.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import PoseErrors, ray_to
from services.registration.core.nail.parameters import Parameter, prior_mean, prior_precision
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import AGREEMENT_OF_PARTS
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import displacement_by_motion
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class PixelScores:
    """What each compared pixel does to the nail's pose."""

    moved_by: NDArray[np.float64]  # small motion per unit of the score, shape (N, 6): rotation (rad), translation (mm)
    score: NDArray[np.float64]  # weighted residual, shape (N,)
    variance: NDArray[np.float64]  # of the score by the noise, correlation included, shape (N,)


@dataclass(frozen=True, slots=True)
class Agreement:
    """How much more the fit errs than its noise explains, and what shows it."""

    pull_ratio: float  # variance of the parts' pulls on the hole axes over the predicted one, at least 1
    bulge: float  # by how much the display brightens the middle of the range from metal to background, either way
    shape: float  # fitted radii beside the part file's, in standard deviations of the prior
    scale_excess: float  # by how much nail and holes together appear larger than in the file, as a share
    noise_inflation: float  # what noise is left correlated after whitening, in pixels: filters leave much
    softness: float  # hardening of the beam below the usual one, in standard deviations of the prior
    sharpening: float  # edge enhancement beside the usual one, either way, in standard deviations of the prior

    @property
    def variance_ratio(self) -> float:
        """By how much the variance of the nail's rotation and shape grows.

        What plain images show too counts nothing; beyond it each symptom adds the square of its excess.
        """
        s = AGREEMENT_OF_PARTS
        excesses = (
            min(self.bulge - s.usual_bulge, s.largest_bulge_excess) / s.bulge_of_one_deviation,
            (self.shape - s.usual_shape) / s.shape_of_one_deviation,
            (self.noise_inflation - s.usual_noise_inflation) / s.inflation_of_one_deviation,
            (self.softness - s.usual_softness) / s.softness_of_one_deviation,
            (self.sharpening - s.usual_sharpening) / s.sharpening_of_one_deviation,
        )
        return self.pull_ratio * (1.0 + sum(max(excess, 0.0) ** 2 for excess in excesses))

    @property
    def error_ratio(self) -> float:
        """The same for standard deviations."""
        return float(np.sqrt(self.variance_ratio))

    def widened(self, errors: PoseErrors, camera_from_nail: Transform[Camera, Nail]) -> PoseErrors:
        """Errors of the pose, grown by what the model does not explain.

        Wrong brightness between the rims turns the nail, but hardly moves it: edges stay in place. A nail that appears
        larger than its file may be nearer than the distance of its holes says: that distance is then not the file's.
        """
        ratio = self.error_ratio
        grown = errors.with_image_errors_times(ratio, float(np.sqrt(ratio)), ratio)
        excess = max(abs(self.scale_excess) - AGREEMENT_OF_PARTS.usual_scale_excess, 0.0)
        depth_error_mm = excess * float(np.linalg.norm(camera_from_nail.translation_mm))
        along_ray = np.concatenate([np.zeros(3), depth_error_mm * ray_to(camera_from_nail)])
        return grown.with_more(np.outer(along_ray, along_ray))


def agreement(
    region: FitRegion, nail: NailPart, pixels: PixelScores, noise_inflation: float, parameters: NDArray[np.float64]
) -> Agreement:
    """Compare the parts' pulls with what the noise predicts, and the nuisance parameters with the usual ones.

    Parameters
    ----------
    noise_inflation
        Mean over the region.
    parameters
        Of the fit, shape (PARAMETER_COUNT,).
    """
    per_pixel = pixels.moved_by @ offsets_by_motion_across(nail).T
    parts = parts_of(region, nail)
    pulls = _sums(parts, per_pixel * pixels.score[:, None])
    variances = _sums(parts, per_pixel**2 * pixels.variance[:, None])
    deviations = (parameters - prior_mean()) * np.sqrt(prior_precision())
    return Agreement(
        pull_ratio=pull_ratio(pulls, variances),
        bulge=abs(float(parameters[Parameter.BULGE])),
        shape=float(np.hypot(deviations[Parameter.HOLE_RADIUS_EXCESS_MM], deviations[Parameter.NAIL_RADIUS_EXCESS_MM])),
        scale_excess=_scale_excess(nail, parameters),
        noise_inflation=noise_inflation,
        softness=-float(deviations[Parameter.HARDENING]),
        sharpening=abs(float(deviations[Parameter.SHARPENING])),
    )


def _scale_excess(nail: NailPart, parameters: NDArray[np.float64]) -> float:
    """Scale, less 1, that explains the fitted radii of nail and holes best."""
    radii_mm = np.array([nail.radius_mm, 0.5 * float(np.mean([hole.diameter_mm for hole in nail.holes]))])
    excess_mm = parameters[[Parameter.NAIL_RADIUS_EXCESS_MM, Parameter.HOLE_RADIUS_EXCESS_MM]]
    return float(radii_mm @ excess_mm / (radii_mm @ radii_mm))


def pull_ratio(pulls: NDArray[np.float64], variances: NDArray[np.float64]) -> float:
    """Observed over predicted variance of the offset that is worst explained, at least 1.

    A part with a large variance counts as much as several small ones: the effective number of parts says how certain
    the observed ratio is, and a prior count of parts that agree keeps chance out of it.

    Parameters
    ----------
    pulls, variances
        Of K parts on M offsets, shape (K, M).
    """
    total = variances.sum(axis=0)
    effective = total**2 / np.sum(variances**2, axis=0)
    observed = np.sum(pulls**2, axis=0) / total
    agreeing = AGREEMENT_OF_PARTS.parts_that_agree
    return float(max(1.0, np.max((agreeing + effective * observed) / (agreeing + effective))))


def parts_of(region: FitRegion, nail: NailPart) -> NDArray[np.int64]:
    """Part of each compared pixel, shape (N,): sectors about each hole, else stretches of either side of the nail."""
    s, x, y = AGREEMENT_OF_PARTS, region.along_mm, region.across_mm
    stretches = np.linspace(x.min(), x.max(), s.stretches + 1)[1:-1]
    part = np.asarray(np.searchsorted(stretches, x) + s.stretches * (y > 0.0), dtype=np.int64)
    first = 2 * s.stretches
    for hole in nail.holes:
        radii, sector = region.about_hole(hole, s.sectors)
        near = (radii < s.about_rim_in_radii) & (np.abs(y) < s.inside_nail_in_radii * nail.radius_mm)
        part[near] = first + sector[near]
        first += s.sectors
    return part


def offsets_by_motion_across(nail: NailPart) -> NDArray[np.float64]:
    """Offsets of the outer holes' ends along the nail's x and y by its small motion, shape (M, 6)."""
    ends = [end for hole in (nail.holes[0], nail.holes[-1]) for end in hole_surface_points(nail, hole)]
    return np.vstack([displacement_by_motion(end)[:2] for end in ends])


def _sums(parts: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of values, shape (N, M), by part; parts without pixels are left out."""
    count = np.bincount(parts)
    sums = np.stack([np.bincount(parts, weights=column) for column in values.T], axis=1)
    return np.asarray(sums[count > 0], dtype=np.float64)
