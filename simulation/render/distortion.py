"""Distortion of an image intensifier, as a map from pixels as measured to pixels of an ideal pinhole camera.

The input screen is a sphere: a point at radius r of the flat image lies at r = R tan(phi) for the angle phi of its arc.
The S-shape turns the rim against the centre by an error function, and a slow wave bends the rest. None of them is a
polynomial. The map runs from measured to ideal pixels, so that the renderer needs no inverse.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from simulation.scenario.imaging_values import FlatPanel, Intensifier

Floats = NDArray[np.float64]


def ideal_from_measured(
    detector: Intensifier | FlatPanel, measured_px: Floats, size_px: int, pixel_mm: float, rotation_deg: float
) -> Floats:
    """Ideal pixels, shape (..., 2), of measured pixels, shape (..., 2).

    Parameters
    ----------
    pixel_mm
        Size of an ideal pixel on the detector.
    rotation_deg
        How far the C-arm is turned from its start: the swirl changes with it.
    """
    if isinstance(detector, FlatPanel):
        return np.array(measured_px, dtype=np.float64)
    middle = 0.5 * (size_px - 1)
    offset = measured_px - middle - np.array(detector.shift_px)
    radius = np.hypot(offset[..., 0], offset[..., 1])
    # Seen from outside the sphere, arcs near the rim are foreshortened: the image is stretched there (pincushion).
    sphere_px = detector.input_radius_mm / pixel_mm
    stretch = np.where(radius > 0.0, sphere_px * np.arctan(radius / sphere_px) / np.maximum(radius, 1e-9), 1.0)
    swirl = detector.swirl_rad + detector.turn_with_angle * rotation_deg
    turn = swirl * erf((radius / middle / detector.swirl_width) ** 2)
    c, s = np.cos(turn), np.sin(turn)
    x = stretch * (c * offset[..., 0] - s * offset[..., 1])
    y = stretch * (s * offset[..., 0] + c * offset[..., 1])
    direction = np.array([np.cos(detector.ripple_direction_rad), np.sin(detector.ripple_direction_rad)])
    phase = 2.0 * np.pi * (offset @ direction) / detector.ripple_wavelength_px + detector.ripple_phase_rad
    wave = detector.ripple_px * np.sin(phase)
    return np.stack([x - wave * direction[1], y + wave * direction[0]], axis=-1) + middle


def measured_from_ideal(
    detector: Intensifier | FlatPanel, ideal_px: Floats, size_px: int, pixel_mm: float, rotation_deg: float
) -> Floats:
    """Measured pixels, shape (..., 2), where ideal pixels, shape (..., 2), appear; to 1e-9 px, by fixed point."""
    measured = np.array(ideal_px, dtype=np.float64)
    for _ in range(60):
        step = ideal_px - ideal_from_measured(detector, measured, size_px, pixel_mm, rotation_deg)
        measured = measured + step
        if float(np.abs(step).max(initial=0.0)) < 1e-9:
            break
    return measured
