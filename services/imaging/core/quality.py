"""What quality control measures in ring images: each ball's residuals over all images, and the distortion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.ball_measurement import found_radii_px, measurement_settings, usual_radii_px
from services.imaging.core.ring_tracking import square_grid_mm
from services.imaging.core.tuning import QUALITY_CONTROL
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import usable_pixels
from shared.xray.measurement import measure_balls

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """One calibrated image.

    Attributes
    ----------
    residual_mm
        From where the calibration puts each ball to where it was measured, in the ring's frame, NaN where it was not
        seen, shape (balls, 2).
    deviation_mm
        Predicted standard deviation of each ball's place per axis, shape (balls,).
    """

    calibration: CArmCalibration
    residual_mm: Array
    deviation_mm: Array


@dataclass(frozen=True, slots=True)
class BallStatistics:
    """One ball over several images.

    Attributes
    ----------
    seen
        Number of images that show it.
    shift_mm
        Median residual in the ring's frame.
    sigmas
        Length of the shift over its standard error.
    moved, rarely_seen
        Whether it is not where the ring's file says, and whether it is lost or always covered.
    """

    seen: int
    shift_mm: tuple[float, float]
    rms_mm: float
    sigmas: float
    moved: bool
    rarely_seen: bool


def residuals_of(calibration: CArmCalibration, ring: RingPart, pixels: FloatImage) -> Residuals:
    """Residual of each ball in one image; `pixels` are those of the image as received, shape (rows, columns)."""
    centre_px, deviation_px = every_ball(calibration, ring, pixels)
    camera = calibration.camera_from_ring.points(ring.balls.position_mm)
    off_px = calibration.distortion.undistort(centre_px) - calibration.camera.project(camera)
    mm_per_px = camera[:, 2] / calibration.camera.focal_length_px
    residual = off_px * mm_per_px[:, None] @ calibration.camera_from_ring.rotation[:2, :2]
    return Residuals(calibration, residual, deviation_px * mm_per_px)


def every_ball(calibration: CArmCalibration, ring: RingPart, pixels: FloatImage) -> tuple[Array, Array]:
    """Centres of the ring's balls and their deviations, NaN where not seen, shapes (balls, 2) and (balls,).

    An outlier takes no part in the calibration, but quality control measures it: it may be a displaced ball.
    """
    balls = calibration.balls
    named = balls.ring_index != NOT_OF_THE_RING
    index = balls.ring_index[named]
    centre, deviation = np.full((len(ring.balls), 2), np.nan), np.full(len(ring.balls), np.nan)
    centre[index], deviation[index] = balls.centre_px[named], balls.standard_deviation_px[named]
    missing = np.flatnonzero(np.isnan(deviation))
    upright = np.ascontiguousarray(pixels[:, ::-1]) if calibration.mirrored else pixels
    radius = usual_radii_px(found_radii_px(balls, ring), ring)
    again = measure_balls(
        upright,
        calibration.image_from_camera(calibration.camera_from_ring.points(ring.balls.position_mm[missing])),
        radius[missing],
        np.concatenate([balls.centre_px[~named], centre[index]]),
        np.concatenate([balls.radius_px[~named], radius[index]]),
        measurement_settings(QUALITY_CONTROL.drift_detector_mm, calibration.pixel_mm, QUALITY_CONTROL.contrast_to_sd),
        usable_pixels(upright, calibration.aperture),
    )
    centre[missing[again.seen]] = again.centre_px[again.seen]
    deviation[missing[again.seen]] = again.standard_deviation_px[again.seen]
    return centre, deviation


def ball_statistics(measured: Sequence[Residuals], ball: int) -> BallStatistics:
    """One ball over all images; one that is always off in the same direction is not where the ring's file says."""
    residual = np.array([m.residual_mm[ball] for m in measured]).reshape(-1, 2)
    deviation = np.array([m.deviation_mm[ball] for m in measured])
    there = np.isfinite(deviation)
    count = int(there.sum())
    rarely = len(measured) >= QUALITY_CONTROL.least_images and count < QUALITY_CONTROL.least_seen * len(measured)
    if count == 0:
        return BallStatistics(0, (0.0, 0.0), 0.0, 0.0, moved=False, rarely_seen=rarely)
    shift = np.median(residual[there], axis=0)
    # one image with a covered ball does not move a median
    error = QUALITY_CONTROL.median_scatter * float(np.sqrt(np.median(np.square(deviation[there])) / count))
    length = float(np.hypot(*shift))
    return BallStatistics(
        seen=count,
        shift_mm=(float(shift[0]), float(shift[1])),
        rms_mm=float(np.sqrt(np.mean(np.square(residual[there])))),
        sigmas=length / error,
        moved=count >= QUALITY_CONTROL.least_images
        and length > QUALITY_CONTROL.shift_mm
        and length > QUALITY_CONTROL.shift_sigmas * error,
        rarely_seen=rarely,
    )


def mean_distortion(measured: Sequence[Residuals]) -> tuple[tuple[float, float], ...]:
    """Mean distortion on the ring's plane, in its frame, in pixels: what a similarity does not explain."""
    if not measured:
        return ()
    fields, grid_mm = [], square_grid_mm(QUALITY_CONTROL.plane_half_side_mm, QUALITY_CONTROL.plane_places)
    for one in measured:
        calibration = one.calibration
        plane = np.pad(grid_mm, ((0, 0), (0, 1)))
        ideal = calibration.camera.project(calibration.camera_from_ring.points(plane))
        image = calibration.distortion.distort(ideal)
        fields.append(_without_similarity(grid_mm, image @ calibration.camera_from_ring.rotation[:2, :2]))
    return tuple((float(x), float(y)) for x, y in np.mean(fields, axis=0))


def _without_similarity(plane_mm: Array, pixel: Array) -> Array:
    plane, image = plane_mm @ np.array([1.0, 1.0j]), pixel @ np.array([1.0, 1.0j])
    design = np.column_stack([plane, np.ones(len(plane))])
    solution, *_ = np.linalg.lstsq(design, image, rcond=None)
    rest = image - design @ solution
    return np.stack([rest.real, rest.imag], axis=1)
