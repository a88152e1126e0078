"""The paper's C-arm calibration: plate by plate, distortion from the near one, the source from the far one.

"It locates the fiducials' projections and pairs them with their spatial location. Next, it computes the distortion
correction parameters, and then computes the calibration parameters." How the balls are paired the paper leaves to
another one; here they have the names that the project's own search gave them, which is the best that can happen to
the method. Their places are measured anew, by the paper's means.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.balls import find_balls
from baselines.fronto_parallel.dewarping import Dewarping, fit_dewarping, on_grid
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Ring
from shared.geometry.parts import RingPart
from shared.geometry.transform import Transform
from shared.xray.aperture import find_usable_area

_SAME_BALL_PX = 2.5
_RADII_SEARCHED, _USUAL_RADII = (0.8, 1.35), (5.0, 95.0)
_LEAST_ON_PLATE = 12
_OUTLIER_ROUNDS = 3
_OUTLIER_DEVIATIONS = 4.0
_LEAST_TOLERANCE_PX = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class _Plate:
    """Balls of one plate: measured pixels, shape (N, 2), and places in the ring's frame, shape (N, 3)."""

    measured_px: NDArray[np.float64]
    position_mm: NDArray[np.float64]

    def chosen(self, keep: NDArray[np.bool_]) -> "_Plate":
        return _Plate(self.measured_px[keep], self.position_mm[keep])


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    """The near plate as the plane of ideal pixels: `pixel = scale * rotation @ q + offset`. What they are is free."""

    z_mm: float
    scale_px_per_mm: float
    rotation: NDArray[np.float64]
    offset_px: NDArray[np.float64]

    def ideal_px(self, plane_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.scale_px_per_mm * plane_mm @ self.rotation.T + self.offset_px)

    def plane_mm(self, ideal_px: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((ideal_px - self.offset_px) @ self.rotation / self.scale_px_per_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """Focal spot in the ring's frame, shape (3,), in mm, its covariance, shape (3, 3), and the rms residual in mm."""

    position_mm: NDArray[np.float64]
    covariance_mm2: NDArray[np.float64]
    rms_mm: float


def calibrate_by_plates(
    pixels: NDArray[np.float32], named: CArmCalibration, ring: RingPart
) -> Accepted[CArmCalibration] | Rejected:
    """Calibrate as the paper does.

    Parameters
    ----------
    pixels
        Image as received, darker is denser, shape (rows, columns).
    named
        The project's own calibration of the same image, of which only the names of the balls are taken, whether the
        display mirrors, and the rough size of the shadows.

    Returns
    -------
    Accepted or Rejected
        Rejected with `ring_too_few_balls` when fewer than twelve balls of a plate were found again.
    """
    upright = np.ascontiguousarray(pixels[:, ::-1]) if named.mirrored else pixels
    balls = _with_names(_found_again(upright, named), named)
    of_ring = balls.ring_index != NOT_OF_THE_RING
    position = ring.balls.position_mm[balls.ring_index[of_ring]]
    seen = _Plate(balls.centre_px[of_ring], position)
    heights = np.round(position[:, 2], 1)
    plates = {z: seen.chosen(heights == z) for z in sorted({float(z) for z in heights})}
    if len(plates) < 2 or min(len(p.measured_px) for p in plates.values()) < _LEAST_ON_PLATE:
        return Rejected((_too_few(plates, len(ring.balls)),))
    near, far = plates[max(plates)], plates[min(plates)]
    plane = _near_plane(named, max(plates))
    dewarping = _without_outliers(near, plane.ideal_px(near.position_mm[:, :2]))
    source = _source(far, dewarping, plane, plane.z_mm - min(plates))
    return Accepted(_assembled(named, balls, dewarping, source, plane))


def _found_again(upright: NDArray[np.float32], named: CArmCalibration) -> BallCandidates:
    radius = named.balls.radius_px[named.balls.ring_index != NOT_OF_THE_RING]
    usual = np.percentile(radius, _USUAL_RADII) if len(radius) else np.ones(2)
    searched = (_RADII_SEARCHED[0] * float(usual[0]), _RADII_SEARCHED[1] * float(usual[1]))
    return find_balls(upright, find_usable_area(upright).mask, searched)


def _with_names(found: BallCandidates, named: CArmCalibration) -> BallCandidates:
    """Give each ball the name of the nearest named one, if that is near enough."""
    index = np.full(len(found.radius_px), NOT_OF_THE_RING, dtype=np.int64)
    if not len(index):
        return found
    for ball, centre in zip(named.balls.ring_index, named.balls.centre_px, strict=True):
        apart = np.hypot(*(found.centre_px - centre).T)
        nearest = int(np.argmin(apart))
        if ball != NOT_OF_THE_RING and apart[nearest] < _SAME_BALL_PX:
            index[nearest] = ball
    return replace(found, ring_index=index)


def _too_few(plates: dict[float, _Plate], expected: int) -> Reason:
    counts = " and ".join(f"{len(plate.measured_px)} at z = {z:g} mm" for z, plate in plates.items()) or "none"
    return Reason(
        ReasonCode.RING_TOO_FEW_BALLS,
        f"circles and correlation found {counts} of the ring's {expected} balls (limit {_LEAST_ON_PLATE} on each of "
        "two plates); uncover more of the ring and take one more image, or use the model method",
    )


def _near_plane(named: CArmCalibration, z_mm: float) -> _Plane:
    """The near plate on ideal pixels, as the project's own calibration has it, so that both can be compared."""
    origin, along_x = named.camera.project(named.camera_from_ring @ np.array([[0.0, 0.0, z_mm], [1.0, 0.0, z_mm]]))
    step = along_x - origin
    scale = float(np.hypot(*step))
    cos, sin = step / scale
    return _Plane(z_mm, scale, np.array([[cos, -sin], [sin, cos]]), origin)


def _without_outliers(plate: _Plate, ideal_px: NDArray[np.float64]) -> Dewarping:
    """Fit, leave out balls that others contradict, fit again."""
    keep = np.ones(len(ideal_px), dtype=bool)
    fit = fit_dewarping(plate.measured_px, ideal_px)
    for _ in range(_OUTLIER_ROUNDS):
        off = np.hypot(*(fit.ideal_px(plate.measured_px) - ideal_px).T)
        keep = off < max(_LEAST_TOLERANCE_PX, _OUTLIER_DEVIATIONS * float(np.median(off[keep])))
        if np.count_nonzero(keep) < _LEAST_ON_PLATE:
            break
        fit = fit_dewarping(plate.measured_px[keep], ideal_px[keep])
    return fit


def _source(
    far: _Plate,
    dewarping: Dewarping,
    plane: _Plane,
    apart_mm: float,
) -> _Source:
    """Focal spot s from the shadows q of the far plate's balls p on the near plate: q = m p + (1 - m) s."""
    shadow = plane.plane_mm(dewarping.ideal_px(far.measured_px))
    p = far.position_mm[:, :2]
    one, none = np.ones(len(p)), np.zeros(len(p))
    design = np.concatenate([np.column_stack([p[:, 0], one, none]), np.column_stack([p[:, 1], none, one])])
    target = np.concatenate([shadow[:, 0], shadow[:, 1]])
    keep = np.ones(len(p), dtype=bool)
    for _ in range(_OUTLIER_ROUNDS):
        both = np.concatenate([keep, keep])
        solution, *_ = np.linalg.lstsq(design[both], target[both], rcond=None)
        off = np.hypot(*(target - design @ solution).reshape(2, -1))
        inliers = off < max(_LEAST_TOLERANCE_PX / 4.0, _OUTLIER_DEVIATIONS * float(np.median(off[keep])))
        if np.array_equal(inliers, keep) or np.count_nonzero(inliers) < _LEAST_ON_PLATE:
            break
        keep = inliers
    m, cx, cy = solution
    rms = float(np.sqrt(np.mean(off[keep] ** 2) / 2.0))
    height = m * apart_mm / (m - 1.0)
    position = np.array([cx / (1.0 - m), cy / (1.0 - m), plane.z_mm - height])
    slope = np.zeros((3, 3))
    slope[0] = [cx / (1.0 - m) ** 2, 1.0 / (1.0 - m), 0.0]
    slope[1] = [cy / (1.0 - m) ** 2, 0.0, 1.0 / (1.0 - m)]
    slope[2, 0] = apart_mm / (m - 1.0) ** 2
    covariance = slope @ np.linalg.inv(design[both].T @ design[both]) @ slope.T * rms**2
    return _Source(position, covariance, rms)


def _assembled(
    named: CArmCalibration, balls: BallCandidates, dewarping: Dewarping, source: _Source, plane: _Plane
) -> CArmCalibration:
    focal = plane.scale_px_per_mm * (plane.z_mm - float(source.position_mm[2]))
    x, y = plane.ideal_px(source.position_mm[:2])
    turn = np.eye(3)
    turn[:2, :2] = plane.rotation
    pose: Transform[Camera, Ring] = Transform.from_rotation_translation(turn, -turn @ source.position_mm)
    return replace(
        named,
        camera=PinholeCamera(np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])),
        camera_from_ring=pose,
        distortion=on_grid(dewarping, named.width_px, named.height_px, named.aperture),
        source_covariance_mm2=source.covariance_mm2,
        balls=balls,
        distortion_residual_px=dewarping.left_out_rms_px,
        reprojection_rms_px=source.rms_mm * plane.scale_px_per_mm,
    )
