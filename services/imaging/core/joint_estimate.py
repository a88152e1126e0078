"""Source position and distortion from the ring's balls, estimated together.

The ring's plane z = 0 is the ideal image plane: a ball at (p, z) appears there, seen from the source s at height S, at
q = s + (p - s) S / (S + z). What leads from measured pixels to that plane is one smooth field (see `field_model`),
whatever tilt and distortion it is made of. Two plates at different heights separate source and field.
"""

from dataclasses import dataclass, replace

import numpy as np

from services.imaging.core.distortion_field import (
    Array,
    FieldSolution,
    Hyperparameters,
    LinearSystem,
    RestrictedLikelihood,
    most_likely_hyperparameters,
    solve_field,
)
from services.imaging.core.tuning import DISTORTION_MODEL, OUTLIER_REJECTION
from shared.xray.discs import Mask
from shared.xray.pixel_scale import pixels

# Guards: the problem is almost linear, so that two or three steps reach a hundredth of a millimetre, and its slopes are
# the same over a millimetre.
_CONVERGED_MM = 1e-2
_NEWTON_STEPS = 10
_SLOPE_STEP_MM = (0.1, 0.1, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Similarity from the ring's plane z = 0 (mm) to ideal pixels: `pixel = scale * rotation @ q + offset`."""

    scale_px_per_mm: float
    rotation: Array
    offset_px: Array

    def pixels(self, plane_mm: Array) -> Array:
        """Ideal pixels, shape (N, 2), of points of the plane, shape (N, 2)."""
        return np.asarray(self.scale_px_per_mm * plane_mm @ self.rotation.T + self.offset_px)

    @property
    def pixel_mm(self) -> float:
        """Pixel pitch at the ring's plate."""
        return 1.0 / self.scale_px_per_mm


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Measured balls.

    Attributes
    ----------
    measured_px, deviation_px
        Centres, shape (N, 2), and their predicted standard deviation per axis, shape (N,).
    position_mm
        In the ring's frame, shape (N, 3).
    """

    measured_px: Array
    deviation_px: Array
    position_mm: Array

    def select(self, keep: Mask) -> "Observations":
        """Those that are marked."""
        return Observations(self.measured_px[keep], self.deviation_px[keep], self.position_mm[keep])


@dataclass(frozen=True, slots=True, eq=False)
class NominalSource:
    """Nominal focal spot in the ring's frame and how well it is known, shape (3,) each, in mm."""

    position_mm: Array
    deviation_mm: Array


@dataclass(frozen=True, slots=True, eq=False)
class JointEstimate:
    """Source and distortion with their uncertainty.

    Attributes
    ----------
    source_mm
        Focal spot in the ring's frame, shape (3,).
    gauge
        From the ring's plane to ideal pixels.
    used
        Which observations were used, shape (N,); the others disagree with all the rest.
    solution
        The field, and the covariance of the source.
    """

    source_mm: Array
    gauge: Gauge
    used: Mask
    solution: FieldSolution

    @property
    def source_covariance_mm2(self) -> Array:
        """Shape (3, 3)."""
        return self.solution.source_covariance_mm2

    def residual_rms_px(self) -> float:
        """Rms per axis of what the fit leaves."""
        return float(np.sqrt(np.mean(np.square(self.solution.fit_residual_px()))))

    def credible(self) -> Mask:
        """Which of the used observations lie where the others predict them, shape (used,).

        A faint ball is measured badly, has little weight and is no outlier; but a disc more than a pixel away from the
        ball's predicted place is something else.
        """
        credible_px = pixels(OUTLIER_REJECTION.credible_detector_mm, self.gauge.pixel_mm)
        uncertain_px = pixels(OUTLIER_REJECTION.uncertain_detector_mm, self.gauge.pixel_mm)
        residual, _ = self.solution.left_out()
        _, of_the_field = self.solution.predict(self.solution.system.measured_px)
        return np.asarray((np.hypot(*residual.T) < credible_px) | (of_the_field > uncertain_px))

    def left_out_rms_px(self) -> float:
        """Rms per axis of the residuals with each ball left out of the fit that predicts it."""
        return float(np.sqrt(np.mean(np.square(self.solution.left_out()[0]))))


def on_plane(position_mm: Array, source_mm: Array) -> Array:
    """Where balls at `position_mm`, shape (N, 3), appear on the plane z = 0 seen from the source, shape (N, 2)."""
    height = -source_mm[2]
    magnification = height / (height + position_mm[:, 2])
    return np.asarray(source_mm[:2] + (position_mm[:, :2] - source_mm[:2]) * magnification[:, None])


def estimate_jointly(
    observations: Observations,
    start_mm: Array,
    nominal: NominalSource,
    gauge: Gauge,
    start: Hyperparameters | None = None,
) -> JointEstimate:
    """Estimate source and distortion; balls that disagree with all the rest are left out.

    Parameters
    ----------
    observations
        Measured balls of the ring.
    start_mm
        First guess of the focal spot in the ring's frame, shape (3,).
    nominal
        Its nominal position and how well that is known.
    gauge
        What ideal pixels are.
    start
        Hyperparameters from which the search starts, of an earlier estimate.

    Returns
    -------
    JointEstimate
        With the hyperparameters that make the observations most likely.
    """
    used = np.ones(len(observations.deviation_px), dtype=bool)
    system = _linearised(observations, start_mm, nominal, gauge)
    # A first estimate only predicts where to measure: half a search is enough for it.
    evaluations = DISTORTION_MODEL.first_evaluations if start is None else DISTORTION_MODEL.evaluations
    found = _hyperparameters(system, start or _first_hyperparameters(system, gauge), evaluations)
    source = start_mm
    while True:
        chosen = observations.select(used)
        source, solution = _converged(chosen, source, nominal, gauge, found)
        bad = _disagreeing(solution)
        if not bad.any() or np.count_nonzero(used) - np.count_nonzero(bad) < OUTLIER_REJECTION.least_balls:
            return JointEstimate(source, gauge, used, solution)
        used[np.flatnonzero(used)[bad]] = False
        system = _linearised(observations.select(used), source, nominal, gauge)
        found = _hyperparameters(system, found, DISTORTION_MODEL.next_evaluations)


def _hyperparameters(system: LinearSystem, start: Hyperparameters, evaluations: int) -> Hyperparameters:
    """The most likely ones, searched once more where the balls lie beside their file's places.

    From the noise of a ring as filed a short search ends where all is noise, and the image would be taken for one
    without distortion.
    """
    s = DISTORTION_MODEL
    found = most_likely_hyperparameters(system, start, evaluations)
    if found.noise_factor < s.displaced_noise_factor:
        return found
    other = replace(
        found,
        amplitude_px=s.displaced_amplitude * found.noise_factor * float(np.median(system.deviation_px)),
        length_px=s.displaced_length * system.half_size_px,
    )
    again = most_likely_hyperparameters(system, other, s.displaced_evaluations)
    return max(found, again, key=RestrictedLikelihood(system, start.order).of)


def _first_hyperparameters(system: LinearSystem, gauge: Gauge) -> Hyperparameters:
    return Hyperparameters(
        order=DISTORTION_MODEL.order,
        amplitude_px=pixels(DISTORTION_MODEL.amplitude_detector_mm, gauge.pixel_mm),
        length_px=DISTORTION_MODEL.length * system.half_size_px,
        noise_factor=DISTORTION_MODEL.noise_factor,
    )


def _converged(
    observations: Observations, source: Array, nominal: NominalSource, gauge: Gauge, prior: Hyperparameters
) -> tuple[Array, FieldSolution]:
    """Newton steps of the source at given hyperparameters: the problem is almost linear, two or three suffice."""
    for _ in range(_NEWTON_STEPS):
        solution = solve_field(_linearised(observations, source, nominal, gauge), prior)
        source = source + solution.step_mm
        if float(np.abs(solution.step_mm).max()) < _CONVERGED_MM:
            break
    return source, solution


def _disagreeing(solution: FieldSolution) -> Mask:
    """The worst balls, when left-out residuals are too large to be noise; the rest is fitted again without them."""
    residual, deviation = solution.left_out()
    size = np.abs(residual / deviation[:, None]).max(axis=1)
    return np.asarray(size > max(OUTLIER_REJECTION.sigmas, OUTLIER_REJECTION.share_of_worst * float(size.max())))


def _linearised(observations: Observations, source: Array, nominal: NominalSource, gauge: Gauge) -> LinearSystem:
    measured, position = observations.measured_px, observations.position_mm
    ideal = gauge.pixels(on_plane(position, source))
    slopes = np.stack(
        [
            (gauge.pixels(on_plane(position, source + step)) - ideal) / float(step.sum())
            for step in np.diag(_SLOPE_STEP_MM)
        ],
        axis=-1,
    )
    low, high = measured.min(axis=0), measured.max(axis=0)
    least_px = pixels(OUTLIER_REJECTION.least_deviation_detector_mm, gauge.pixel_mm)
    return LinearSystem(
        measured_px=measured,
        deviation_px=np.maximum(observations.deviation_px, least_px),
        centre_px=0.5 * (low + high),
        half_size_px=float(0.5 * (high - low).max()),
        target_px=ideal - measured,
        slopes=slopes,
        source_prior=np.stack([nominal.position_mm - source, nominal.deviation_mm]),
    )
