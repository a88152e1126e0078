"""What the acceptance of a fitted nail depends on: how holes are seen, what the model leaves, whether parts agree.

At the optimum the pulls of all pixels on the pose cancel. Under the noise model the pull of one part, a sector of a
rim or a stretch of an edge, has a known variance. Where the model does not hold, as after local contrast enhancement
or a noise filter, the parts pull against one another by more, and the nuisance parameters leave their usual range.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.image import HoleView, ResidualStatistics
from services.registration.core.estimation.pose_estimate import PoseErrors, length_that_gives_depth_mm
from services.registration.core.nail.between_holes import turns_between_holes, turns_by_second_bores
from services.registration.core.nail.covariance import after_background, motion_gain
from services.registration.core.nail.forward_model import visible_fraction_without_metal
from services.registration.core.nail.hole_content import turns_by_channels
from services.registration.core.nail.least_squares import Problem, Solution, linear_response
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.parameters import Parameter, prior_mean, prior_precision
from services.registration.core.nail.region import FitRegion
from services.registration.core.nail.search.holes import hole_midpoints_mm
from services.registration.core.tuning import AGREEMENT_OF_PARTS, FOREIGN_OBJECTS, NAIL_EVIDENCE, NAIL_PRIORS
from shared.geometry.lines import displacement_by_motion
from shared.geometry.parts import Hole, NailPart, across_holes, hole_surface_points, place_of_hole
from shared.xray.pixel_scale import pixels as pixels_of
from shared.xray.tuning import DEVIATION_PER_MEDIAN

# A metal is another than the file's beyond so many standard errors of its attenuation (95 %).
_CERTAIN_DEVIATIONS = 2.0


def hole_views(problem: Problem, solution: Solution) -> tuple[HoleView, ...]:
    """Opening and contrast of each hole of the nail."""
    region = problem.model.region
    clear = solution.linear.traced.transmission.ravel()[region.compared] > NAIL_EVIDENCE.open_transmission
    noise = float(np.sqrt(np.median(1.0 / problem.weight)))
    contrast = _local_step(problem, solution) / noise
    inside_nail = np.abs(region.across_mm) < NAIL_EVIDENCE.inside_nail_in_radii * problem.model.nail.radius_mm
    depth_mm = float(problem.model.pose(solution.parameters).translation_mm[2])
    pixel_mm = depth_mm / problem.model.camera.focal_length_px * region.sampling.reduction

    def view(hole: Hole) -> HoleView:
        radius_mm, (x_mm, y_mm) = 0.5 * hole.diameter_mm, place_of_hole(problem.model.nail, hole)
        away_mm = np.hypot(hole.beyond_slot(region.along_mm - x_mm), region.across_mm - y_mm)
        seen = clear & (away_mm < NAIL_EVIDENCE.near_hole_in_radii * radius_mm) & inside_nail
        area_mm2 = np.pi * radius_mm**2 + 4.0 * radius_mm * hole.half_slot_mm
        opening = float(np.count_nonzero(seen)) * pixel_mm**2 / area_mm2
        return HoleView(hole.id, min(opening, 1.0), float(np.median(contrast[seen])) if np.any(seen) else 0.0)

    return tuple(view(hole) for hole in problem.model.nail.holes)


def rim_shares(region: FitRegion, nail: NailPart) -> tuple[float, ...]:
    """Share of each hole's rim, by direction seen from the hole's middle, where pixels are compared."""
    s = FOREIGN_OBJECTS
    shares = []
    for hole in nail.holes:
        radii, direction = region.about_hole(nail, hole, s.directions)
        near = np.abs(radii - 1.0) < s.about_rim_in_radii
        seen = np.bincount(direction[near], minlength=s.directions)
        usual = float(np.median(seen[seen > 0])) if np.any(seen) else np.inf
        shares.append(float(np.mean(seen >= s.seen_share * usual)))
    return tuple(shares)


def log_attenuation(problem: Problem, solution: Solution) -> float:
    """Logarithm of the metal's attenuation over that of the part's material, nearer to 0 by two standard errors."""
    place = int(np.count_nonzero(problem.free[: Parameter.LOG_ATTENUATION]))
    found = float(solution.parameters[Parameter.LOG_ATTENUATION])
    deviation = float(np.sqrt(np.linalg.inv(solution.equations.matrix)[place, place]))
    return float(np.copysign(max(abs(found) - _CERTAIN_DEVIATIONS * deviation, 0.0), found))


def residual_statistics(problem: Problem, solution: Solution, noise: NoiseModel) -> ResidualStatistics:
    """What the model leaves of the pixels."""
    region, residual = problem.model.region, solution.linear.residual
    most, visible = NAIL_EVIDENCE.clipped_deviations, solution.linear.visible
    standardised = np.clip(residual * np.sqrt(problem.weight), -most, most)
    smooth = region.compared_values(region.smoothed(standardised, NAIL_EVIDENCE.structure_blur_px))
    rim = (visible > NAIL_EVIDENCE.rim_from) & (visible < NAIL_EVIDENCE.rim_to)
    elsewhere = ~rim
    reference = float(np.sqrt(np.mean(smooth[elsewhere] ** 2))) if np.any(elsewhere) else 1.0
    at_rims = float(np.sqrt(np.mean(smooth[rim] ** 2))) if np.any(rim) else 0.0
    inflation = float(noise.inflation.mean())
    spot, darkness = _spot(problem, solution, noise), _darkness(problem, solution)
    return ResidualStatistics(at_rims / max(reference, 1e-9), inflation, spot, darkness)


def _spot(problem: Problem, solution: Solution, noise: NoiseModel) -> float:
    """Largest smoothed residual at a hole, over the step from metal to background, where it is far beyond noise."""
    region, linear = problem.model.region, solution.linear
    near = np.zeros(len(region.compared), dtype=bool)
    for hole in problem.model.nail.holes:
        x, y = place_of_hole(problem.model.nail, hole)
        reach_mm = 0.5 * hole.diameter_mm + NAIL_EVIDENCE.about_hole_mm
        near |= np.hypot(hole.beyond_slot(region.along_mm - x), region.across_mm - y) < reach_mm
    step, blur_px = np.abs(_local_step(problem, solution)), NAIL_EVIDENCE.spot_blur_px
    deviations = np.abs(region.compared_values(region.smoothed(linear.residual / np.sqrt(noise.variance), blur_px)))
    certain = deviations > NAIL_EVIDENCE.certain_deviations * DEVIATION_PER_MEDIAN * np.median(deviations)
    smallest_step = NAIL_EVIDENCE.least_step * np.median(step)
    share = np.abs(region.compared_values(region.smoothed(linear.residual, blur_px))) / np.maximum(step, smallest_step)
    return float(share[near & certain].max(initial=0.0))


def _darkness(problem: Problem, solution: Solution) -> float:
    """Largest smoothed residual on the dark side, over the usual step from metal to background."""
    region, step = problem.model.region, float(np.median(np.abs(_local_step(problem, solution))))
    blur_px = pixels_of(FOREIGN_OBJECTS.blur_detector_mm, region.sampling.pixel_mm)
    smooth = region.compared_values(region.smoothed(solution.linear.residual, blur_px))
    return float((-smooth / max(step, 1e-9)).max(initial=0.0))


def _local_step(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """From the grey value behind metal to the one without metal, under the guide's body, shape (N,)."""
    linear = solution.linear
    without_metal = visible_fraction_without_metal(problem.model, solution.parameters)
    return without_metal * (linear.background - linear.floor)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How much more the fit errs than its noise explains, and what shows it."""

    pull_ratio: float  # variance of the parts' pulls on the hole axes over the predicted one, at least 1
    bulge: float  # by how much the display brightens the middle of the range from metal to background, either way
    shape: float  # fitted radii beside the part file's, in standard deviations of the prior
    shape_at_scale: float  # the same beside the part file's at the nail's own scale
    scale_excess: float  # by how much nail and holes together appear larger than in the file, as a share
    noise_inflation: float  # what noise is left correlated after whitening, in pixels: filters and blur leave much
    softness: float  # hardening of the beam below the usual one, in standard deviations of the prior
    sharpening: float  # edge enhancement beside the usual one, either way, in standard deviations of the prior
    metal: float  # logarithm of the metal's attenuation over that of the part's material, either way
    tails: float  # variance of the residuals over the one by their median: filters against noise leave a few large ones
    between_holes: NDArray[np.float64]  # mean square of the holes' own turns across them, in rad², shape (2, 2)
    second_bores: NDArray[np.float64]  # the same of the turn to the holes as filed, where they look bored twice
    channels: NDArray[np.float64]  # the same of the turn to the fit with a channel in what fills the holes

    @property
    def variance_ratio(self) -> float:
        """By how much the variance of the nail's rotation and shape grows.

        What plain images show too counts nothing; beyond it each symptom adds the square of its excess. Where a filter
        has left heavy tails, what is left of the noise does not determine the errors, however well the parts agree;
        elsewhere a scale of nail and holes is that of the part, and correlated noise that of a blurred image.
        """
        s = AGREEMENT_OF_PARTS
        has_tails = self.tails > s.usual_tails
        shape = self.shape if has_tails else self.shape_at_scale
        noise_inflation = self.noise_inflation if has_tails else s.usual_noise_inflation
        excesses = (
            min(self.bulge - s.usual_bulge, s.largest_bulge_excess) / s.bulge_of_one_deviation,
            (shape - s.usual_shape) / s.shape_of_one_deviation,
            (noise_inflation - s.usual_noise_inflation) / s.inflation_of_one_deviation,
            (self.softness - s.usual_softness) / s.softness_of_one_deviation,
            (self.sharpening - s.usual_sharpening) / s.sharpening_of_one_deviation,
            (self.metal - s.usual_metal) / s.metal_of_one_deviation,
        )
        by_symptoms = self.pull_ratio * (1.0 + sum(max(excess, 0.0) ** 2 for excess in excesses))
        return max(by_symptoms, (self.tails / s.usual_tails) ** 2)

    @property
    def error_ratio(self) -> float:
        """The same for standard deviations."""
        return float(np.sqrt(self.variance_ratio))

    def widened(self, errors: PoseErrors, nail: NailPart) -> PoseErrors:
        """Errors of the pose, grown by what the model does not explain.

        Wrong brightness between the rims turns the nail, but hardly moves it: edges stay in place. How far does not
        follow from the noise, of which a filter may have left next to none.
        """
        ratio = self.error_ratio
        return errors.with_image_errors_times(ratio, float(np.sqrt(ratio)), ratio).with_more(self._turned(nail))

    def spread_of_holes_mm(self, nail: NailPart) -> float:
        """Standard deviation of the holes' places along the nail that explains its scale.

        The nail's depth follows from the distance of its holes. If it appears larger than at that depth, it is nearer,
        and so are its holes to each other: of two independent deviations the difference has twice the variance.
        """
        excess = np.sqrt(max(self.scale_excess**2 - AGREEMENT_OF_PARTS.usual_scale_excess**2, 0.0))
        return float(np.sqrt(0.5) * excess * length_that_gives_depth_mm(nail))

    @property
    def second_bore_deg(self) -> float:
        """How far the holes as filed may be turned from the fit (rms), where they look bored twice."""
        return float(np.degrees(np.sqrt(np.trace(self.second_bores))))

    @property
    def channel_deg(self) -> float:
        """How far the holes may be turned from the fit (rms) by a channel in what fills them."""
        return float(np.degrees(np.sqrt(np.trace(self.channels))))

    def _turned(self, nail: NailPart) -> NDArray[np.float64]:
        """Covariance by turns across the axes through the holes' middle, (6, 6): by processing, and by the holes."""
        s = AGREEMENT_OF_PARTS
        share = max(1.0 - s.processed_from / self.variance_ratio, 0.0)
        by_processing = share * np.radians(s.processed_sd_deg) ** 2 * np.eye(2)
        return covariance_of_turns(nail, by_processing + self.between_holes + self.second_bores + self.channels)


def covariance_of_turns(nail: NailPart, square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of the nail's small motion, shape (6, 6), by turns across the holes' axes through their middle.

    Parameters
    ----------
    square
        Mean square of the turns about the two directions across the holes, in rad², shape (2, 2).
    """
    across = across_holes(nail)
    turns = np.hstack([across, -np.cross(across, hole_midpoints_mm(nail).mean(axis=0))])
    return np.asarray(turns.T @ square @ turns)


def agreement_of_parts(problem: Problem, solution: Solution, noise: NoiseModel) -> Agreement:
    """Compare the parts' pulls on the pose with what the noise predicts, nuisance parameters with usual ones."""
    region, nail, parameters = problem.model.region, problem.model.nail, solution.parameters
    linear = linear_response(solution.linear, solution.equations.jacobian)
    moved_by = after_background(problem, solution, linear, motion_gain(problem, solution))
    per_pixel = moved_by @ offsets_by_motion_across(nail).T
    score, variance = problem.weight * solution.linear.residual, problem.weight**2 * noise.variance * noise.inflation
    parts = parts_of(region, nail)
    pulls = _sums(parts, per_pixel * score[:, None])
    variances = _sums(parts, per_pixel**2 * variance[:, None])
    deviations = (parameters - prior_mean()) * np.sqrt(prior_precision())
    scale_excess, shape_at_scale = scale_and_shape(nail, parameters)
    return Agreement(
        pull_ratio=pull_ratio(pulls, variances),
        bulge=abs(float(parameters[Parameter.BULGE])),
        shape=float(np.hypot(deviations[Parameter.HOLE_RADIUS_EXCESS_MM], deviations[Parameter.NAIL_RADIUS_EXCESS_MM])),
        shape_at_scale=shape_at_scale,
        scale_excess=scale_excess,
        noise_inflation=float(noise.inflation.mean()),
        softness=-float(deviations[Parameter.HARDENING]),
        sharpening=abs(float(deviations[Parameter.SHARPENING])),
        metal=abs(float(parameters[Parameter.LOG_ATTENUATION])),
        tails=_tails(solution.linear.residual, noise),
        between_holes=turns_between_holes(problem, solution, noise),
        second_bores=turns_by_second_bores(problem, solution, noise),
        channels=turns_by_channels(problem, solution, noise),
    )


def _tails(residual: NDArray[np.float64], noise: NoiseModel) -> float:
    """Mean square of standardised residuals, from residuals of shape (N,).

    Each counts up to a limit, so that a few pixels of a foreign object do not look like a filter.
    """
    most = AGREEMENT_OF_PARTS.largest_deviation
    return float(np.mean(np.clip(residual / np.sqrt(noise.variance), -most, most) ** 2))


def scale_and_shape(nail: NailPart, parameters: NDArray[np.float64]) -> tuple[float, float]:
    """Scale, less 1, that explains the fitted radii of nail and holes best, and what is left, in deviations."""
    radii_mm = np.array([nail.radius_mm, 0.5 * float(np.mean([hole.diameter_mm for hole in nail.holes]))])
    excess_mm = parameters[[Parameter.NAIL_RADIUS_EXCESS_MM, Parameter.HOLE_RADIUS_EXCESS_MM]]
    scale = float(radii_mm @ excess_mm / (radii_mm @ radii_mm))
    return scale, float(np.linalg.norm(excess_mm - scale * radii_mm)) / NAIL_PRIORS.radius_sd_mm


def pull_ratio(pulls: NDArray[np.float64], variances: NDArray[np.float64]) -> float:
    """Observed over predicted variance of the offset that is worst explained, at least 1.

    A part with a large variance counts as much as several small ones: the effective number of parts determines how
    certain the observed ratio is, and a prior count of parts that agree keeps chance out of it.

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
        radii, sector = region.about_hole(nail, hole, s.sectors)
        near = (radii < s.about_rim_in_radii) & (np.abs(y) < s.inside_nail_in_radii * nail.radius_mm)
        part[near] = first + sector[near]
        first += s.sectors
    return part


def offsets_by_motion_across(nail: NailPart) -> NDArray[np.float64]:
    """Offsets of the outer holes' ends across their axes by the nail's small motion, shape (M, 6)."""
    across = across_holes(nail)
    ends = [end for hole in (nail.holes[0], nail.holes[-1]) for end in hole_surface_points(nail, hole)]
    return np.vstack([across @ displacement_by_motion(end) for end in ends])


def _sums(parts: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of values, shape (N, M), by part; parts without pixels are left out."""
    count = np.bincount(parts)
    sums = np.stack([np.bincount(parts, weights=column) for column in values.T], axis=1)
    return np.asarray(sums[count > 0], dtype=np.float64)
