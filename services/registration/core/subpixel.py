"""Reading images between their pixels, and letting what is read count by degrees.

Yes and no at a pixel's border or a limit would make a likelihood jump; its optimum would depend on where they fall.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """Where rows of samples are highest, M rows.

    Attributes
    ----------
    place
        Between the samples, shape (M,).
    height
        Of the sample the parabola's vertex is next to, shape (M,).
    inside
        False where a row is highest at one of its ends: its peak lies elsewhere, shape (M,).
    """

    place: NDArray[np.float64]
    height: NDArray[np.float64]
    inside: NDArray[np.bool_]


def profile_px(reach_px: float) -> NDArray[np.float64]:
    """Where to read across an edge, as far as a reach to either side: a pixel apart, shape (S,).

    Between pixels a picture read linearly has corners at every pixel. Read more densely, its peaks are at corners: they
    would be drawn to the pixels' rows and columns, by up to a quarter of a pixel at two samples a pixel.
    """
    steps = int(np.floor(2.0 * reach_px + 1e-9))
    return np.asarray(np.arange(steps + 1) - 0.5 * steps, dtype=np.float64)


def peaks_of(samples: NDArray[np.float64], places: NDArray[np.float64]) -> Peaks:
    """Vertex of the parabola through the highest of a row's samples, shape (M, S), and its neighbours.

    Parameters
    ----------
    places
        Where the samples were taken, evenly spaced, shape (S,).
    """
    row = np.arange(len(samples))
    peak = np.clip(samples.argmax(axis=1), 1, len(places) - 2)
    before, at, after = samples[row, peak - 1], samples[row, peak], samples[row, peak + 1]
    steps = vertex_step(before, at, after)
    return Peaks(places[peak] + steps * (places[1] - places[0]), at, (at >= before) & (at >= after))


def vertex_step(
    before: NDArray[np.floating], at: NDArray[np.floating], after: NDArray[np.floating]
) -> NDArray[np.float64]:
    """From a highest sample to the vertex of the parabola through it and its neighbours, -0.5 to 0.5 of their step."""
    bend = np.minimum(before - 2.0 * at + after, -1e-12)
    return np.asarray(np.clip(0.5 * (before - after) / bend, -0.5, 0.5), dtype=np.float64)


def between_pixels(picture: NDArray[np.float32], points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """A picture's values at points (x, y), shape (..., 2), linearly between pixels, its border's outside; (...).

    Points are rounded to 1/32 of a pixel, OpenCV's way, which is 0.016 px at most.
    """
    shape = points_px.shape[:-1]
    if points_px.size == 0:
        return np.zeros(shape)
    x, y = (points_px[..., k].astype(np.float32).reshape(len(points_px), -1) for k in range(2))
    read = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read.reshape(shape), dtype=np.float64)


def ramp(value: NDArray[np.float64], none: float, whole: float) -> NDArray[np.float64]:
    """0 up to one value, 1 from another on, and linear in between."""
    return np.clip((value - none) / (whole - none), 0.0, 1.0)
