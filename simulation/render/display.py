"""The C-arm's display: automatic exposure, a curve nobody documents, edge enhancement, turned and mirrored at will."""

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.scenario.imaging_values import Display

Floats = NDArray[np.float64]
Image = NDArray[np.float32]
Grey = NDArray[np.unsignedinteger]


def curve(display: Display, value: Image) -> Image:
    """Grey value, 0 to 1, of a relative signal clipped to 0 to 1: monotone for toe and shoulder from 0 to 1."""
    v = np.clip(value, 0.0, 1.0) ** display.gamma
    return np.asarray(v - display.toe * v * (1.0 - v) ** 2 + display.shoulder * v * v * (1.0 - v), dtype=np.float32)


def grey_values(display: Display, signal: Image, window: Image) -> Grey:
    """Grey values of the signal, in the detector's own orientation; outside the window is black.

    Full scale is that of the container (255 or 65535); fewer bits than the container's are shifted up.
    """
    white = float(np.percentile(signal[window > 0.5], display.white_percentile))
    shown = curve(display, signal * np.float32(display.white_level / white))
    if display.sharpening > 0.0:
        smooth = cv2.GaussianBlur(shown, (0, 0), display.sharpening_px)
        shown = shown + np.float32(display.sharpening) * (shown - smooth)
    shown = np.clip(shown * window, 0.0, 1.0)
    levels = np.round(shown * (2**display.bits - 1)).astype(np.uint16)
    if display.bits == 8:
        return np.asarray(levels, dtype=np.uint8)
    return np.asarray(levels << (16 - display.bits), dtype=np.uint16)


def as_shown(display: Display, image: Grey) -> Grey:
    """Turn, then mirror the image as the display does."""
    turned = np.rot90(image, display.quarter_turns)
    return np.ascontiguousarray(turned[:, ::-1] if display.mirrored else turned)


def turned_points(display: Display, points_px: Floats, size_px: int) -> Floats:
    """Pixels of the detector's image, shape (..., 2), in the turned image, before any mirroring."""
    points = np.array(points_px, dtype=np.float64)
    for _ in range(display.quarter_turns % 4):
        points = np.stack([points[..., 1], size_px - 1 - points[..., 0]], axis=-1)
    return points


def turned_from_detector(display: Display) -> Floats:
    """Rotation, shape (3, 3), from axes along the detector's columns and rows to those of the turned image."""
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(np.linalg.matrix_power(quarter, display.quarter_turns % 4))
