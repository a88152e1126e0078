"""Cramér-Rao limits: how well a ball's centre, and a ray, can be known at all from one image with white noise."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.imaging.scenes import BLUR_PX, CArm, Shadow, displayed, monomials, transmission
from shared.geometry.parts import RingPart

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HALF_PX = 24
_STEP = 1e-3
_REACH_PX = 6.0
_NUISANCES = 7


def centre_variance_px2(shadow: Shadow, ball: int, light: Array, noise: float) -> float:
    """Least variance per axis of one ball's centre.

    Radius and absorption of it and of all balls that it touches, six terms of the background and the blur are unknown
    as well.

    Parameters
    ----------
    shadow
        All balls of the image.
    ball
        Which one.
    light
        Transmission without balls, shape (rows, columns).
    noise
        Standard deviation of a pixel's grey value, in the units of `displayed`.
    """
    members = _touching(shadow, ball)
    corner = np.round(shadow.centre_px[ball]).astype(int) - _HALF_PX
    size = 2 * _HALF_PX + 1
    rows = np.clip(np.arange(corner[1], corner[1] + size), 0, light.shape[0] - 1)
    columns = np.clip(np.arange(corner[0], corner[0] + size), 0, light.shape[1] - 1)
    ground = light[np.ix_(rows, columns)]
    local = shadow.select(members)
    place = local.centre_px - corner
    y, x = np.mgrid[:size, :size]
    distance = np.hypot(x[..., None] - place[:, 0], y[..., None] - place[:, 1]) - local.radius_px
    near = distance.min(axis=2) < _REACH_PX
    start = np.concatenate([place.ravel(), local.radius_px, local.absorption, np.zeros(_NUISANCES)])
    columns_of = [
        (_grey(start + step, ground)[near] - _grey(start - step, ground)[near]) / (2.0 * _STEP)
        for step in _STEP * np.eye(len(start))
    ]
    jacobian = np.stack(columns_of, axis=1)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * noise**2
    return float(0.5 * (covariance[0, 0] + covariance[1, 1]))


def _touching(shadow: Shadow, ball: int) -> NDArray[np.int64]:
    """The ball first, then those whose shadows touch its own."""
    gap = np.hypot(*(shadow.centre_px - shadow.centre_px[ball]).T) - shadow.radius_px - shadow.radius_px[ball]
    others = np.flatnonzero((gap < 1.0) & (np.arange(len(gap)) != ball))
    return np.concatenate([[ball], others]).astype(np.int64)


def _grey(p: Array, ground: Array) -> Array:
    count = (len(p) - _NUISANCES) // 4
    place, radius, absorption = p[: 2 * count].reshape(count, 2), p[2 * count : 3 * count], p[3 * count : 4 * count]
    size = ground.shape[0]
    y, x = (np.mgrid[:size, :size] - 0.5 * size) / (0.5 * size)
    a = p[4 * count :]
    factor = 1.0 + a[0] + a[1] * x + a[2] * y + a[3] * x * x + a[4] * x * y + a[5] * y * y
    return displayed(transmission(Shadow(place, radius, absorption), (size, size)) * ground * factor, BLUR_PX + a[6])


def ray_deviation_px(c_arm: CArm, ring: RingPart, seen: Mask, deviation_px: Array, targets_mm: Array) -> Array:
    """Least standard deviation per axis of the rays through the true images of points, in pixels of those points.

    For a quintic distortion whose order is known, a source that is not, and centres with given deviations.

    Parameters
    ----------
    seen, deviation_px
        Balls that were measured, shape (balls,), and the deviation of each, shape (balls,).
    targets_mm
        Points at which the rays are to pass, in the ring's frame, shape (N, 3).

    Returns
    -------
    Array
        Shape (N,).
    """
    balls = ring.balls.position_mm[seen]

    def rows(points_mm: Array) -> tuple[Array, Array]:
        """Derivatives of the two image coordinates by polynomial and source."""
        basis = monomials((c_arm.image(points_mm) - 512.0) / 512.0, 5)
        slopes = [(c_arm_with(c_arm, step).image(points_mm) - c_arm.image(points_mm)) / 0.1 for step in 0.1 * np.eye(3)]
        nothing = np.zeros_like(basis)
        slope = np.stack(slopes, axis=-1)
        return np.hstack([basis, nothing, slope[:, 0]]), np.hstack([nothing, basis, slope[:, 1]])

    weight = 1.0 / deviation_px[seen][:, None] ** 2
    x, y = rows(balls)
    covariance = np.linalg.inv(x.T @ (weight * x) + y.T @ (weight * y))
    u, v = rows(targets_mm)
    variance = 0.5 * sum(np.einsum("ni,ij,nj->n", r, covariance, r) for r in (u, v))
    return np.asarray(np.sqrt(variance))


def c_arm_with(c_arm: CArm, step_mm: Array) -> CArm:
    """The same image plane, with the focal spot elsewhere."""
    return CArm(c_arm.source_mm + step_mm, c_arm.turn_rad, c_arm.distortion, c_arm.coefficients)
