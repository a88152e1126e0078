"""Subpixel peaks of sampled profiles, bilinear sampling, and weights that change gradually.

A hard decision at a pixel's border or at a limit makes a likelihood discontinuous: its optimum would then depend on
where borders and limits fall.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class SubpixelPeaks:
    """Maxima of M sampled profiles."""

    position: NDArray[np.float64]  # vertex of the parabola through the highest sample and its neighbours, shape (M,)
    height: NDArray[np.float64]  # the highest sample, shape (M,)
    # False where a profile is highest at one of its ends: its peak lies outside, shape (M,)
    interior: NDArray[np.bool_]


def profile_offsets_px(reach_px: float) -> NDArray[np.float64]:
    """Sample positions across an edge, one pixel apart and symmetric, up to a reach to either side, shape (S,).

    A bilinearly interpolated image has corners at every pixel. With denser samples the peaks are drawn to those
    corners: by up to a quarter of a pixel at two samples a pixel.
    """
    steps = int(np.floor(2.0 * reach_px + 1e-9))
    return np.asarray(np.arange(steps + 1) - 0.5 * steps, dtype=np.float64)


def subpixel_peaks(samples: NDArray[np.float64], positions: NDArray[np.float64]) -> SubpixelPeaks:
    """Peak of each profile, samples of shape (M, S) at evenly spaced positions of shape (S,)."""
    row = np.arange(len(samples))
    peak = np.clip(samples.argmax(axis=1), 1, len(positions) - 2)
    before, at, after = samples[row, peak - 1], samples[row, peak], samples[row, peak + 1]
    offset = subpixel_offset(before, at, after) * (positions[1] - positions[0])
    return SubpixelPeaks(positions[peak] + offset, at, (at >= before) & (at >= after))


def subpixel_offset(
    before: NDArray[np.floating], at: NDArray[np.floating], after: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Vertex of the parabola through a highest sample and its neighbours: -0.5 to 0.5 of their spacing from it."""
    curvature = np.minimum(before - 2.0 * at + after, -1e-12)  # no division by zero on a plateau
    return np.asarray(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5), dtype=np.float64)


def sample_bilinear(image: NDArray[np.float32], points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Image values at points (x, y), shape (..., 2), replicated beyond the border; shape (...).

    OpenCV rounds points to 1/32 of a pixel, which is 0.016 px at most.
    """
    shape = points_px.shape[:-1]
    if points_px.size == 0:
        return np.zeros(shape)
    x, y = (points_px[..., k].astype(np.float32).reshape(len(points_px), -1) for k in range(2))
    values = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.reshape(shape), dtype=np.float64)


def linear_ramp(value: NDArray[np.float64], zero_at: float, one_at: float) -> NDArray[np.float64]:
    """0 up to one value, 1 from another on, and linear in between."""
    return np.clip((value - zero_at) / (one_at - zero_at), 0.0, 1.0)
