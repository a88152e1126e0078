"""Sixteen balls whose image moved during the exposure."""

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE_PX, SPACING_PX, RADIUS_PX = 256, 48, 5.0


def balls() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and radii of a grid of sixteen, none at a whole pixel."""
    x, y = np.meshgrid(np.arange(4), np.arange(4))
    centre = SPACING_PX * np.column_stack([x.ravel(), y.ravel()]) + np.array([50.3, 51.8])
    return centre, np.full(len(centre), RADIUS_PX)


def moved_image(length_px: float, angle_deg: float) -> NDArray[np.float32]:
    """Balls on a slope of grey, averaged over a straight movement about their places."""
    centre, radius = balls()
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX].astype(np.float64)
    along = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    total = np.zeros((SIDE_PX, SIDE_PX))
    steps = np.linspace(-0.5, 0.5, 41)
    for step in steps:
        image = 1000.0 + 0.8 * x - 0.5 * y
        for (u, v), r in zip(centre + step * length_px * along, radius, strict=True):
            near = np.s_[int(v) - 12 : int(v) + 14, int(u) - 12 : int(u) + 14]
            image[near] -= 300.0 * np.clip(0.5 - (np.hypot(x[near] - u, y[near] - v) - r), 0.0, 1.0)
        total += image
    return np.asarray(cv2.GaussianBlur(total / len(steps), (0, 0), 0.7), dtype=np.float32)
