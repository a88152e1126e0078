"""One image in, the C-arm's camera, distortion and ring pose out, or a refusal with its reasons."""

from dataclasses import dataclass

import numpy as np

from services.imaging.core.camera_model import SourceAndField, build_calibration, field_on_grid
from services.imaging.core.image_checks import MOTION_LIMIT_PX, motion_blur_px, unusable_reason
from services.imaging.core.joint_estimate import Gauge, JointEstimate, Observations, estimate_jointly, on_plane
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import FoundRing, find_ring
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, Aperture, BallCandidates, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea, find_usable_area
from shared.xray.discs import Array, FloatImage, Mask
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls

LEAST_BALLS_FRACTION = 0.4
CENTRAL_DEVIATION_LIMIT_PX = 0.5
SOURCE_DEVIATION_LIMIT_MM = 5.0
_SOURCE_SD_MM = (100.0, 100.0, 150.0)
_GAUGE_REACH = 0.25
_CENTRAL_REACH = 0.2
_FIRST_LOOK = MeasurementSettings(drift_px=1.2)
_SECOND_LOOK = MeasurementSettings(drift_px=0.6)
_SHRUNK = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """The image un-mirrored, with what was found in it.

    Attributes
    ----------
    predicted
        Where the ring's balls must be, with the radius they seem to have.
    others
        Dark discs that are not the ring's.
    """

    pixels: FloatImage
    area: UsableArea
    mirrored: bool
    predicted: Discs
    candidates: BallCandidates
    others: Discs
    identified: int
    runner_up: int


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
    view = _unmirrored(pixels, area, found, ring, nominal)
    return _estimate_and_judge(view, ring, nominal)


def _unmirrored(
    pixels: FloatImage, area: UsableArea, found: FoundRing, ring: RingPart, nominal: NominalGeometry
) -> _View:
    """Turn image and discs so that they obey physics: a mirrored image is reflected about its vertical middle."""
    candidates, identity = found.candidates, found.identity
    width = pixels.shape[1]
    centre, predicted = candidates.centre_px.copy(), identity.predicted_px.copy()
    if identity.mirrored:
        centre[:, 0], predicted[:, 0] = width - 1 - centre[:, 0], width - 1 - predicted[:, 0]
        pixels, area = np.ascontiguousarray(pixels[:, ::-1]), _mirrored_area(area)
    depth = nominal.source_to_ring_mm + ring.balls.position_mm[:, 2]
    radius = _SHRUNK * 0.5 * ring.balls.diameter_mm * nominal.source_to_detector_mm / (depth * nominal.pixel_mm)
    known = identity.candidate_of_ball >= 0
    radius[known] = candidates.radius_px[identity.candidate_of_ball[known]]
    others = np.ones(len(centre), dtype=bool)
    others[identity.candidate_of_ball[known]] = False
    ring_index = np.full(len(centre), NOT_OF_THE_RING, dtype=np.int64)
    ring_index[identity.candidate_of_ball[known]] = np.flatnonzero(known)
    return _View(
        pixels=pixels,
        area=area,
        mirrored=identity.mirrored,
        predicted=Discs(predicted, radius),
        candidates=BallCandidates(
            centre, candidates.radius_px, candidates.contrast, candidates.standard_deviation_px, ring_index
        ),
        others=Discs(centre[others], candidates.radius_px[others]),
        identified=identity.identified,
        runner_up=identity.runner_up,
    )


def _mirrored_area(area: UsableArea) -> UsableArea:
    circle = area.aperture
    if circle is not None:
        circle = Aperture((area.mask.shape[1] - 1 - circle.centre_px[0], circle.centre_px[1]), circle.radius_px)
    return UsableArea(np.ascontiguousarray(area.mask[:, ::-1]), circle)


def _estimate_and_judge(
    view: _View, ring: RingPart, nominal: NominalGeometry
) -> Accepted[CArmCalibration] | Rejected:
    """Measure and estimate twice: the first estimate says where the balls of the second measurement must be."""
    predicted, settings = view.predicted, _FIRST_LOOK
    start = np.array([0.0, 0.0, -nominal.source_to_ring_mm])
    measured = _measure(view, predicted, settings)
    for settings in (_SECOND_LOOK, None):
        if (few := _too_few(measured.seen, ring)) is not None:
            return Rejected((few,))
        estimate = _estimate(measured, ring, start, _image_centre(view), view.pixels.shape[1])
        model = _source_and_field(estimate, view)
        if settings is not None:
            start = estimate.source_mm
            ideal = estimate.gauge.pixels(on_plane(ring.balls.position_mm, estimate.source_mm))
            radius = np.where(measured.seen, measured.radius_px, predicted.radius_px)
            predicted = Discs(model.field.distort(ideal), radius)
            measured = _measure(view, predicted, settings)
    reasons = _judge(view, measured, estimate, model)
    if reasons:
        return Rejected(reasons)
    return Accepted(_calibration(view, measured, estimate, model))


def _measure(view: _View, predicted: Discs, settings: MeasurementSettings) -> BallMeasurements:
    return measure_balls(
        view.pixels,
        predicted.centre_px,
        predicted.radius_px,
        view.others.centre_px,
        view.others.radius_px,
        settings,
        view.area.mask,
    )


def _too_few(seen: Mask, ring: RingPart) -> Reason | None:
    count, needed = int(np.count_nonzero(seen)), int(np.ceil(LEAST_BALLS_FRACTION * len(ring.balls)))
    if count >= needed:
        return None
    return Reason(
        ReasonCode.RING_TOO_FEW_BALLS,
        f"{count} of the ring's {len(ring.balls)} balls could be measured (at least {needed}); "
        "open the collimator or uncover the ring and take another image",
    )


def _image_centre(view: _View) -> Array:
    if view.area.aperture is not None:
        return np.array(view.area.aperture.centre_px)
    rows, columns = view.pixels.shape
    return np.array([0.5 * (columns - 1), 0.5 * (rows - 1)])


def _estimate(
    measured: BallMeasurements, ring: RingPart, start: Array, centre_px: Array, width_px: int
) -> JointEstimate:
    seen = measured.seen
    position = ring.balls.position_mm[seen]
    observations = Observations(measured.centre_px[seen], measured.standard_deviation_px[seen], position)
    gauge = similarity_near(on_plane(position, start), observations.measured_px, centre_px, _GAUGE_REACH * width_px)
    return estimate_jointly(observations, start, gauge, np.array(_SOURCE_SD_MM))


def similarity_near(plane_mm: Array, pixel: Array, centre_px: Array, reach_px: float) -> Gauge:
    """Similarity from the ring's plane to pixels that fits best near the image's centre."""
    weight = np.exp(-0.5 * np.square(pixel - centre_px).sum(axis=1) / reach_px**2) + 1e-9
    weight /= weight.sum()
    plane, image = plane_mm @ np.array([1.0, 1.0j]), pixel @ np.array([1.0, 1.0j])
    plane_mean, image_mean = weight @ plane, weight @ image
    factor = (weight * np.conj(plane - plane_mean)) @ (image - image_mean) / (weight @ np.abs(plane - plane_mean) ** 2)
    offset = image_mean - factor * plane_mean
    rotation = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]]) / abs(factor)
    return Gauge(float(abs(factor)), rotation, np.array([offset.real, offset.imag]))


def _source_and_field(estimate: JointEstimate, view: _View) -> SourceAndField:
    rows, columns = view.pixels.shape
    field = field_on_grid(estimate, columns, rows, view.area.aperture)
    return SourceAndField(estimate.source_mm, estimate.source_covariance_mm2, estimate.gauge, field)


def _judge(
    view: _View, measured: BallMeasurements, estimate: JointEstimate, model: SourceAndField
) -> tuple[Reason, ...]:
    reasons = []
    alone = measured.seen & ~measured.overlapped
    moved = motion_blur_px(view.pixels, measured.centre_px[alone], measured.radius_px[alone])
    if moved > MOTION_LIMIT_PX:
        reasons.append(
            Reason(
                ReasonCode.MOTION_BLUR,
                f"the balls are smeared over {moved:.1f} px (limit {MOTION_LIMIT_PX:g} px); "
                "hold leg and C-arm still and take another image",
            )
        )
    central = _central_deviation_px(view, model)
    source = float(np.sqrt(np.linalg.eigvalsh(estimate.source_covariance_mm2)[-1]))
    if central > CENTRAL_DEVIATION_LIMIT_PX or source > SOURCE_DEVIATION_LIMIT_MM:
        reasons.append(
            Reason(
                ReasonCode.CALIBRATION_EXTRAPOLATED,
                f"the ring's balls leave the image's middle uncertain by {central:.2f} px (limit "
                f"{CENTRAL_DEVIATION_LIMIT_PX:g}) and the focal spot by {source:.1f} mm (limit "
                f"{SOURCE_DEVIATION_LIMIT_MM:g}); uncover the ring around the middle and take another image",
            )
        )
    return tuple(reasons)


def _central_deviation_px(view: _View, model: SourceAndField) -> float:
    """Largest predicted standard deviation of the distortion near the image's middle."""
    angle = np.arange(12) * np.pi / 6.0
    reach = _CENTRAL_REACH * min(view.pixels.shape)
    around = _image_centre(view) + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return float(model.field.standard_deviation_at(around).max())


def _calibration(
    view: _View, measured: BallMeasurements, estimate: JointEstimate, model: SourceAndField
) -> CArmCalibration:
    used = np.flatnonzero(measured.seen)[estimate.used]
    rows, columns = view.pixels.shape
    return build_calibration(
        model,
        columns,
        rows,
        mirrored=view.mirrored,
        aperture=view.area.aperture,
        balls=_all_balls(view, measured, used, estimate.prior.noise_factor),
        balls_expected=len(measured.seen),
        distortion_residual_px=float(np.sqrt(np.nanmean(np.square(estimate.left_out_px)))),
        reprojection_rms_px=float(np.sqrt(np.nanmean(np.square(estimate.residual_px)))),
        runner_up_margin=float(view.identified - view.runner_up),
    )


def _all_balls(view: _View, measured: BallMeasurements, used: Array, noise_factor: float) -> BallCandidates:
    """The ring's balls as measured in the end, then the discs that belong to something else."""
    centre = measured.centre_px[used]
    distance = np.hypot(*(view.candidates.centre_px[:, None] - centre[None]).transpose(2, 0, 1)).min(axis=1)
    other = (view.candidates.ring_index == NOT_OF_THE_RING) & (distance > 2.0)
    c = view.candidates
    factor = noise_factor * _SECOND_LOOK.noise_factor
    return BallCandidates(
        centre_px=np.concatenate([centre, c.centre_px[other]]),
        radius_px=np.concatenate([measured.radius_px[used], c.radius_px[other]]),
        contrast=np.concatenate([measured.contrast[used], c.contrast[other]]),
        standard_deviation_px=np.concatenate(
            [noise_factor * measured.standard_deviation_px[used], factor * c.standard_deviation_px[other]]
        ),
        ring_index=np.concatenate([used, np.full(int(other.sum()), NOT_OF_THE_RING)]).astype(np.int64),
    )
