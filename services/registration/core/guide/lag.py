"""Lag: what is left of earlier frames where the C-arm or the patient moved, from the shadows of the guide's balls.

C-arms average frames, the newest with most weight: what moved has a faint tail on one side. The rim that is
fitted to a ball follows the newest frame more than the centroid of its attenuation does, which follows the mean of all
frames: how far they are apart shows the lag. The ring is fixed to the detector and has no tail.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.guide.measure import GuideImage, shadows
from services.registration.core.tuning import LAG
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform
from shared.xray.measurement import Discs
from shared.xray.pixel_scale import pixels as pixels_of

# Standard deviation of a median over that of a mean, and what four in five of normal errors are smaller than. Uneven
# backgrounds displace some centroids: the usual median of deviations would not show it where they are less than half.
_OF_MEDIAN, _MOST, _SIZE_OF_MOST = 1.2533, 0.8, 1.2816
# Guard of the logarithm: of the background's grey value, darker than any ball.
_LEAST_SHARE = 1e-3


def lag_px(
    image: GuideImage, pixels: NDArray[np.float32], pose: Transform[Camera, Guide], used: NDArray[np.bool_]
) -> float:
    """How far the balls' shadows reach to one side beyond what chance explains, in pixels; 0 where none shows.

    Parameters
    ----------
    pixels
        Un-mirrored image as received, darker is denser, shape (rows, columns).
    used
        Balls that the pose was fitted to, shape (N,).
    """
    offsets = tail_offsets_px(image, pixels, pose, used)
    return beyond_chance_px(offsets) if len(offsets) >= LAG.fewest_balls else 0.0


def beyond_chance_px(offsets_px: NDArray[np.float64]) -> float:
    """Length of the median of tails, shape (K, 2), beyond what chance explains in its own direction.

    Across it tails may scatter by more: a bone's edge displaces centroids to its own sides alone.
    """
    middle = np.median(offsets_px, axis=0)
    length = float(np.linalg.norm(middle))
    if length == 0.0:
        return 0.0
    along = (offsets_px - middle) @ (middle / length)
    spread = float(np.quantile(np.abs(along), _MOST)) / _SIZE_OF_MOST
    error = _OF_MEDIAN * spread / np.sqrt(len(offsets_px))
    return float(np.sqrt(max(length**2 - (LAG.chance_sigmas * error) ** 2, 0.0)))


def tail_offsets_px(
    image: GuideImage, pixels: NDArray[np.float32], pose: Transform[Camera, Guide], used: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Centroid of the attenuation of each ball that stands alone, from where the pose has its middle, shape (K, 2)."""
    balls = shadows(image.calibration, image.guide.balls, pose)
    pixel_mm = image.calibration.pixel_mm
    rim_px = pixels_of(LAG.tail_detector_mm, pixel_mm), pixels_of(LAG.rim_detector_mm, pixel_mm)
    alone = used & _stand_alone(balls, image.ring_shadows, rim_px[1])
    found = [
        _tail_offset(pixels, image.usable, balls.centre_px[k], float(balls.radius_px[k]), rim_px)
        for k in np.flatnonzero(alone)
    ]
    return np.array([one for one in found if one is not None]).reshape(-1, 2)


def _stand_alone(balls: Discs, ring: Discs, rim_px: float) -> NDArray[np.bool_]:
    """Which balls have nothing known within the rim that shows the background, shape (N,)."""
    others = np.concatenate([balls.centre_px, ring.centre_px])
    reach = np.concatenate([balls.radius_px, ring.radius_px])
    apart = np.linalg.norm(balls.centre_px[:, None] - others[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    return np.asarray((apart > balls.radius_px[:, None] + rim_px + reach).all(axis=1))


def _tail_offset(
    pixels: NDArray[np.float32],
    usable: NDArray[np.bool_],
    centre_px: NDArray[np.float64],
    radius_px: float,
    rim_px: tuple[float, float],
) -> NDArray[np.float64] | None:
    """Centroid of one ball's attenuation from a centre, shape (2,); None where the image ends or nothing is darker."""
    reach = int(np.ceil(radius_px + rim_px[1]))
    left, top = (int(value) for value in np.rint(centre_px) - reach)
    side = 2 * reach + 1
    if left < 0 or top < 0 or left + side > pixels.shape[1] or top + side > pixels.shape[0]:
        return None
    here = slice(top, top + side), slice(left, left + side)
    if not usable[here].all():
        return None
    rows, columns = np.mgrid[:side, :side]
    x, y = columns + left - centre_px[0], rows + top - centre_px[1]
    from_edge = np.hypot(x, y) - radius_px
    rim, inside = (from_edge > rim_px[0]) & (from_edge <= rim_px[1]), from_edge <= rim_px[0]
    grey = pixels[here].astype(np.float64)
    level = float(np.median(grey[rim]))
    if level <= 0.0:
        return None
    # Attenuation adds up in the logarithm, so that a slope of the background draws no shadow to one side.
    attenuation = -np.log(np.maximum(grey / level, _LEAST_SHARE))
    plane = np.column_stack([np.ones(np.count_nonzero(rim)), x[rim], y[rim]])
    background = np.linalg.lstsq(plane, attenuation[rim], rcond=None)[0]
    shadow = (attenuation - background[0] - background[1] * x - background[2] * y)[inside]
    total = float(shadow.sum())
    if total <= 0.0:
        return None
    return np.array([float(shadow @ x[inside]), float(shadow @ y[inside])]) / total
