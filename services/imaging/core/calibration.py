"""One image in, the C-arm's camera, distortion and ring pose out, or a refusal with its reasons."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.ball_measurement import (
    View,
    found_radii_px,
    look_widely,
    usual_radii_px,
)
from services.imaging.core.camera_model import SourceAndField, build_calibration, field_on_grid
from services.imaging.core.checks import judge, motion_reason, too_few_reason, unusable_reason
from services.imaging.core.distortion_field import FieldPrior
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
from services.imaging.core.ring_search import find_ring, upright_discs, view_of
from services.imaging.core.similarity_hypotheses import make_seeds
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.discs import Array, FloatImage, compile_fits
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings

_SOURCE_SD_MM = (100.0, 100.0, 150.0)
_GAUGE_REACH = 0.25
_SAME_DISC_PX = 2.0
_RADIUS_RANGE = 0.12
# Shadows look smaller than geometry says: a ball's rim absorbs little, and bright air swallows it.
_SHRUNK = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where to start the estimate.

    Attributes
    ----------
    source_mm
        Focal spot in the ring's frame, shape (3,).
    roughness
        Of the distortion, from an earlier estimate of the same image; None where there is none.
    """

    source_mm: Array
    roughness: FieldPrior | None = None


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
    area = find_usable_area(pixels)
    if (unusable := unusable_reason(pixels, area.mask)) is not None:
        return Rejected((unusable,))
    found = find_ring(pixels, area, ring, nominal)
    if isinstance(found, Rejected):
        return found
    discs = upright_discs(found, pixels.shape[1])
    view = view_of(pixels, area, found.identity, discs)
    placed = _placed(view, discs, ring, nominal)
    settings = look_widely(placed.deviation_px, nominal.pixel_mm)
    return calibrate_there(view, placed.balls, settings, ring, nominal, placed.start)


def _nominal_source(nominal: NominalGeometry) -> NominalSource:
    return NominalSource(np.array([0.0, 0.0, -nominal.source_to_ring_mm]), np.array(_SOURCE_SD_MM))


def calibrate_there(
    view: View,
    expected: Discs,
    settings: MeasurementSettings,
    ring: RingPart,
    nominal: NominalGeometry,
    start: Start,
) -> Accepted[CArmCalibration] | Rejected:
    """Measure the ring's balls where they are expected, and calibrate from them."""
    measured = view.measure(expected, settings)
    if (few := too_few_reason(measured, ring)) is not None:
        moved = motion_reason(view, measured, expected)
        return Rejected((few,) if moved is None else (moved, few))
    seen = measured.seen
    observations = Observations(
        measured.centre_px[seen], measured.standard_deviation_px[seen], ring.balls.position_mm[seen]
    )
    estimate = _estimate(observations, view, nominal, start)
    model = _source_and_field(view, estimate)
    if reasons := judge(view, measured, expected, model):
        return Rejected(reasons)
    return Accepted(_calibration(view, measured, estimate, model))


def _estimate(observations: Observations, view: View, nominal: NominalGeometry, start: Start) -> JointEstimate:
    plane = on_plane(observations.position_mm, start.source_mm)
    gauge = similarity_near(plane, observations.measured_px, view.centre_px, _GAUGE_REACH * view.pixels.shape[1])
    return estimate_jointly(observations, start.source_mm, _nominal_source(nominal), gauge, start.roughness)


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
class _Placed:
    """Where a first estimate, from the discs as they were found one by one, says that the ring's balls are.

    Attributes
    ----------
    balls
        All of them, with the radii that they were found to have.
    deviation_px
        Standard deviation of the distortion at each of them, per axis, shape (M,).
    start
        For an estimate from what is measured there.
    """

    balls: Discs
    deviation_px: Array
    start: Start


def _placed(view: View, discs: BallCandidates, ring: RingPart, nominal: NominalGeometry) -> _Placed:
    named = discs.select(discs.ring_index != NOT_OF_THE_RING)
    observations = Observations(named.centre_px, named.standard_deviation_px, ring.balls.position_mm[named.ring_index])
    estimate = _estimate(observations, view, nominal, Start(_nominal_source(nominal).position_mm))
    field = _source_and_field(view, estimate).field
    centre_px = field.distort(estimate.gauge.pixels(on_plane(ring.balls.position_mm, estimate.source_mm)))
    start = Start(estimate.source_mm, estimate.solution.prior)
    balls = Discs(centre_px, _plausible_radii(named, ring, nominal))
    return _Placed(balls, field.standard_deviation_at(centre_px), start)


def _plausible_radii(named: BallCandidates, ring: RingPart, nominal: NominalGeometry) -> Array:
    """Radii as found, but no farther from others of that size than the display's curve explains, shape (M,)."""
    found_px, nominal_px = found_radii_px(named, ring), _SHRUNK * nominal.ball_radii_px(ring)
    usual_px = usual_radii_px(found_px, ring, nominal_px)
    radius_px = np.where(np.isfinite(found_px), found_px, nominal_px)
    return np.clip(radius_px, (1.0 - _RADIUS_RANGE) * usual_px, (1.0 + _RADIUS_RANGE) * usual_px)


def _source_and_field(view: View, estimate: JointEstimate) -> SourceAndField:
    rows, columns = view.pixels.shape
    field = field_on_grid(estimate.solution, columns, rows, view.area.aperture)
    return SourceAndField(estimate.source_mm, estimate.source_covariance_mm2, estimate.gauge, field)


def _calibration(
    view: View, measured: BallMeasurements, estimate: JointEstimate, model: SourceAndField
) -> CArmCalibration:
    used = np.flatnonzero(measured.seen)[estimate.used][estimate.credible()].astype(np.int64)
    rows, columns = view.pixels.shape
    return build_calibration(
        model,
        columns,
        rows,
        mirrored=view.mirrored,
        aperture=view.area.aperture,
        balls=_all_balls(view, measured, used, estimate.solution.prior.noise_factor),
        balls_expected=len(measured.seen),
        distortion_residual_px=estimate.left_out_rms_px(),
        reprojection_rms_px=estimate.residual_rms_px(),
        runner_up_margin=view.margin,
    )


def _all_balls(view: View, measured: BallMeasurements, used: NDArray[np.int64], noise_factor: float) -> BallCandidates:
    """The ring's balls as measured in the end, then the discs that belong to something else."""
    centre, others = measured.centre_px[used], view.others
    distance = np.hypot(*(others.centre_px[:, None] - centre[None]).transpose(2, 0, 1)).min(axis=1)
    other = distance > _SAME_DISC_PX
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
    """Run every compiled function once, on next to nothing; machine code of an earlier start is loaded instead."""
    compile_fits()
    place, one = np.array([[16.0, 16.0], [20.0, 16.0]]), np.ones(2)
    motion_blur_px(np.ones((32, 32), np.float32), place, one)
    discs = BallCandidates(place, one, one, one, np.full(2, NOT_OF_THE_RING, dtype=np.int64))
    make_seeds(discs, place, np.zeros(2, dtype=np.int64), 4.0)
