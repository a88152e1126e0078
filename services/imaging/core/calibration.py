"""One image in, the C-arm's camera, distortion and ring pose out, or a refusal with its reasons."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.ball_measurement import (
    UprightImage,
    found_radii_px,
    settings_of_places,
    usual_radii_px,
)
from services.imaging.core.camera_model import SourceAndField, build_calibration, field_on_grid
from services.imaging.core.checks import calibration_reasons, motion_reason, too_few_reason, unusable_reason
from services.imaging.core.distortion_field import Hyperparameters
from services.imaging.core.joint_estimate import (
    Gauge,
    JointEstimate,
    NominalSource,
    Observations,
    estimate_jointly,
    on_plane,
)
from services.imaging.core.motion_blur import motion_blur_px
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import find_ring, upright_discs, upright_image
from services.imaging.core.similarity_hypotheses import similarity_hypotheses
from services.imaging.core.tuning import DISTORTION_MODEL, NOMINAL_VALUES, RING_MEASUREMENT
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.dead_pixels import fill_dead_pixels
from shared.xray.discs import Array, FloatImage, compile_fits
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings
from shared.xray.pixel_scale import pixels as in_pixels


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where to start the estimate.

    Attributes
    ----------
    source_mm
        Focal spot in the ring's frame, shape (3,).
    hyperparameters
        Of the distortion, from an earlier estimate of the same image; None where there is none.
    """

    source_mm: Array
    hyperparameters: Hyperparameters | None = None


def calibrate_image(
    pixels: FloatImage, ring: RingPart, nominal: NominalGeometry
) -> Accepted[CArmCalibration] | Rejected:
    """Calibrate the C-arm from the ring in one image.

    Parameters
    ----------
    pixels
        Image as received, darker is denser, any monotone scale of grey values, shape (rows, columns).
    ring
        The ring on the detector.
    nominal
        C-arm values, wrong by up to ten per cent.

    Returns
    -------
    Accepted or Rejected
        The calibration in pixels of the un-mirrored image, or the reasons why there is none.
    """
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    filled = fill_dead_pixels(pixels).pixels
    area = find_usable_area(filled)  # a black row or column would part the field in two
    if (unusable := unusable_reason(pixels, area.mask)) is not None:
        return Rejected((unusable,))
    found = find_ring(filled, area, ring, nominal)
    if isinstance(found, Rejected):
        return found
    discs = upright_discs(found, filled.shape[1])
    image = upright_image(filled, area, found.identity, discs, nominal.pixel_mm)
    predicted = _predicted(image, discs, ring, nominal)
    settings = settings_of_places(predicted.deviation_px, nominal.pixel_mm)
    return calibrate_there(image, predicted.balls, settings, ring, nominal, predicted.start)


def _nominal_source(nominal: NominalGeometry) -> NominalSource:
    return NominalSource(np.array([0.0, 0.0, -nominal.source_to_ring_mm]), np.array(NOMINAL_VALUES.source_sd_mm))


def calibrate_there(
    image: UprightImage,
    expected: Discs,
    settings: MeasurementSettings,
    ring: RingPart,
    nominal: NominalGeometry,
    start: Start,
) -> Accepted[CArmCalibration] | Rejected:
    """Measure the ring's balls where they are expected, and calibrate from them."""
    measured = image.measure(expected, settings)
    if (few := too_few_reason(measured, ring)) is not None:
        moved = motion_reason(image, measured, expected)
        return Rejected((few,) if moved is None else (moved, few))
    seen = measured.seen
    deviation_px = np.hypot(measured.standard_deviation_px, tolerance_px(ring, nominal))
    observations = Observations(measured.centre_px[seen], deviation_px[seen], ring.balls.position_mm[seen])
    estimate = _estimate(observations, image, nominal, start)
    model = _source_and_field(image, estimate)
    calibration = _calibration(image, measured, estimate, model)
    if reasons := calibration_reasons(image, measured, expected, model, calibration.ring_spread_mm):
        return Rejected(reasons)
    return Accepted(replace(calibration, focal_spot_mm=nominal.focal_spot_mm))


def _estimate(observations: Observations, image: UprightImage, nominal: NominalGeometry, start: Start) -> JointEstimate:
    plane = on_plane(observations.position_mm, start.source_mm)
    gauge = similarity_near(
        plane, observations.measured_px, image.centre_px, DISTORTION_MODEL.gauge_reach * image.pixels.shape[1]
    )
    return estimate_jointly(observations, start.source_mm, _nominal_source(nominal), gauge, start.hyperparameters)


def similarity_near(plane_mm: Array, pixel: Array, centre_px: Array, reach_px: float) -> Gauge:
    """Similarity from the ring's plane to pixels that fits best near the image's centre.

    Parameters
    ----------
    plane_mm, pixel
        Corresponding points, shape (N, 2) each.
    centre_px, reach_px
        Where the fit counts: the weight falls off as a Gaussian.
    """
    weight = np.exp(-0.5 * np.square(pixel - centre_px).sum(axis=1) / reach_px**2) + 1e-9
    weight /= weight.sum()
    plane, image = plane_mm @ np.array([1.0, 1.0j]), pixel @ np.array([1.0, 1.0j])
    plane_mean, image_mean = weight @ plane, weight @ image
    factor = (weight * np.conj(plane - plane_mean)) @ (image - image_mean) / (weight @ np.abs(plane - plane_mean) ** 2)
    offset = image_mean - factor * plane_mean
    rotation = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]]) / abs(factor)
    return Gauge(float(abs(factor)), rotation, np.array([offset.real, offset.imag]))


@dataclass(frozen=True, slots=True, eq=False)
class _Prediction:
    """Where a first estimate, from the discs as detected one by one, predicts the ring's balls.

    Attributes
    ----------
    balls
        All of them, with their detected radii.
    deviation_px
        Standard deviation of the distortion at each of them, per axis, shape (M,).
    start
        For an estimate from what is measured there.
    """

    balls: Discs
    deviation_px: Array
    start: Start


def _predicted(image: UprightImage, discs: BallCandidates, ring: RingPart, nominal: NominalGeometry) -> _Prediction:
    named = discs.select(discs.ring_index != NOT_OF_THE_RING)
    place_px = tolerance_px(ring, nominal)
    deviation_px = np.hypot(named.standard_deviation_px, place_px[named.ring_index])
    observations = Observations(named.centre_px, deviation_px, ring.balls.position_mm[named.ring_index])
    estimate = _estimate(observations, image, nominal, Start(_nominal_source(nominal).position_mm))
    field = _source_and_field(image, estimate).field
    centre_px = field.distort(estimate.gauge.pixels(on_plane(ring.balls.position_mm, estimate.source_mm)))
    start = Start(estimate.source_mm, estimate.solution.prior)
    balls = Discs(centre_px, _plausible_radii(named, ring, nominal))
    return _Prediction(balls, np.hypot(field.standard_deviation_at(centre_px), place_px), start)


def tolerance_px(ring: RingPart, nominal: NominalGeometry) -> Array:
    """Standard deviation of the shadows of the ring's balls by the tolerance of their places, per axis, shape (N,)."""
    depth_mm = nominal.source_to_ring_mm + ring.balls.position_mm[:, 2]
    scale = nominal.ring_scale_px_per_mm * nominal.source_to_ring_mm / depth_mm
    return np.asarray(scale * ring.balls.position_sd_mm)


def _plausible_radii(named: BallCandidates, ring: RingPart, nominal: NominalGeometry) -> Array:
    """Radii as detected, limited to what the display's curve explains among balls of one size, shape (M,)."""
    range_ = RING_MEASUREMENT.radius_range
    found_px, nominal_px = found_radii_px(named, ring), RING_MEASUREMENT.shrunk * nominal.ball_radii_px(ring)
    usual_px = usual_radii_px(found_px, ring, nominal_px)
    radius_px = np.where(np.isfinite(found_px), found_px, nominal_px)
    return np.clip(radius_px, (1.0 - range_) * usual_px, (1.0 + range_) * usual_px)


def _source_and_field(image: UprightImage, estimate: JointEstimate) -> SourceAndField:
    rows, columns = image.pixels.shape
    field = field_on_grid(estimate.solution, columns, rows, image.area.aperture)
    return SourceAndField(estimate.source_mm, estimate.source_covariance_mm2, estimate.gauge, field)


def _calibration(
    image: UprightImage, measured: BallMeasurements, estimate: JointEstimate, model: SourceAndField
) -> CArmCalibration:
    used = np.flatnonzero(measured.seen)[estimate.used][estimate.credible()].astype(np.int64)
    rows, columns = image.pixels.shape
    return build_calibration(
        model,
        columns,
        rows,
        mirrored=image.mirrored,
        aperture=image.area.aperture,
        balls=_all_balls(image, measured, used, estimate.solution.prior.noise_factor),
        balls_expected=len(measured.seen),
        distortion_residual_px=estimate.left_out_rms_px(),
        reprojection_rms_px=estimate.residual_rms_px(),
        runner_up_margin=image.margin,
    )


def _all_balls(
    image: UprightImage, measured: BallMeasurements, used: NDArray[np.int64], noise_factor: float
) -> BallCandidates:
    """The ring's balls as measured last, then the discs that belong to something else."""
    centre, others = measured.centre_px[used], image.others
    distance = np.hypot(*(others.centre_px[:, None] - centre[None]).transpose(2, 0, 1)).min(axis=1)
    other = distance > in_pixels(RING_MEASUREMENT.same_disc_detector_mm, image.pixel_mm)
    factor = noise_factor * measured.noise_factor
    return BallCandidates(
        centre_px=np.concatenate([centre, others.centre_px[other]]),
        radius_px=np.concatenate([measured.radius_px[used], others.radius_px[other]]),
        contrast=np.concatenate([measured.contrast[used], others.contrast[other]]),
        standard_deviation_px=np.concatenate(
            [noise_factor * measured.standard_deviation_px[used], factor * others.standard_deviation_px[other]]
        ),
        ring_index=np.concatenate([used, others.ring_index[other]]),
    )


def compile_core() -> None:
    """Run every compiled function once, on tiny inputs, so that the first image does not wait for their compilation."""
    compile_fits()
    place, one = np.array([[16.0, 16.0], [20.0, 16.0]]), np.ones(2)
    motion_blur_px(np.ones((32, 32), np.float32), place, one)
    discs = BallCandidates(place, one, one, one, np.full(2, NOT_OF_THE_RING, dtype=np.int64))
    similarity_hypotheses(discs, place, np.zeros(2, dtype=np.int64), 4.0)
