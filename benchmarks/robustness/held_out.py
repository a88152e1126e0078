"""Kinds that judge and fit nothing: processing and objects other than those on which parameters are fitted."""

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.around import Around
from benchmarks.robustness.objects import Objects, SteelBox, axes_across, rod
from benchmarks.robustness.scene import Drawn
from benchmarks.robustness.tone import Grey, Processed, clipped, compressed

_SPLINE = np.array([1.0, 4.0, 6.0, 4.0, 1.0], dtype=np.float32) / 16.0
_SHRUNK_LEVELS = 3
# Median of the absolute value of normal noise over its standard deviation.
_MEDIAN_OF_NORMAL = 0.6745


def range_compression(share: Grey, generator: np.random.Generator) -> Processed:
    """The slow part of the image is compressed, details are raised."""
    sigma_px = float(generator.uniform(15.0, 60.0))
    keep, gain = float(generator.uniform(0.3, 0.7)), float(generator.uniform(1.0, 1.8))
    slow = cv2.GaussianBlur(share, (0, 0), sigma_px)
    shown = keep * slow + (1.0 - keep) * float(np.mean(slow)) + gain * (share - slow)
    return Processed(clipped(np.asarray(shown)), {"sigma_px": sigma_px, "keep": keep, "gain": gain})


def local_normalisation(share: Grey, generator: np.random.Generator) -> Processed:
    """Mixed with itself after each neighbourhood got the same mean and spread."""
    sigma_px, weight = float(generator.uniform(20.0, 50.0)), float(generator.uniform(0.2, 0.5))
    mean = cv2.GaussianBlur(share, (0, 0), sigma_px)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(share**2, (0, 0), sigma_px) - mean**2, 1e-6))
    shown = (1.0 - weight) * share + weight * (0.5 + 0.18 * (share - mean) / spread)
    return Processed(clipped(np.asarray(shown)), {"sigma_px": sigma_px, "weight": weight})


def anisotropic_diffusion(share: Grey, generator: np.random.Generator) -> Processed:
    """Perona and Malik's smoothing, which stops at edges (IEEE PAMI 12, 1990, equation 9)."""
    rounds, edge = int(generator.integers(4, 16)), float(generator.uniform(0.01, 0.05))
    smooth = share.astype(np.float32)
    for _ in range(rounds):
        wide = np.pad(smooth, 1, mode="edge")
        steps = (wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:])
        smooth = smooth + 0.2 * sum(_flow(np.asarray(one - smooth), edge) for one in steps)
    return Processed(clipped(smooth), {"rounds": rounds, "edge": edge})


def _flow(difference: NDArray[np.float32], edge: float) -> NDArray[np.float32]:
    return np.asarray(difference * np.exp(-((difference / edge) ** 2)), dtype=np.float32)


def wavelet_shrinkage(share: Grey, generator: np.random.Generator) -> Processed:
    """Small details of three wavelet levels are taken for noise and removed (spline wavelets, soft threshold)."""
    threshold, smooth = float(generator.uniform(1.0, 3.0)), share
    kept = np.zeros_like(share)
    for level in range(_SHRUNK_LEVELS):
        kernel = np.zeros(4 * 2**level + 1, dtype=np.float32)
        kernel[:: 2**level] = _SPLINE
        smoother = np.asarray(cv2.sepFilter2D(smooth, -1, kernel, kernel), dtype=np.float32)
        detail = smooth - smoother
        limit = threshold * float(np.median(np.abs(detail))) / _MEDIAN_OF_NORMAL
        kept = kept + np.sign(detail) * np.maximum(np.abs(detail) - limit, 0.0)
        smooth = smoother
    return Processed(clipped(smooth + kept), {"threshold": threshold})


def window_and_jpeg(share: Grey, generator: np.random.Generator) -> Processed:
    """Black and white both cut off, a power of the grey values, and JPEG."""
    low, high = float(generator.uniform(0.003, 0.03)), float(generator.uniform(0.92, 0.995))
    gamma, quality = float(generator.uniform(0.7, 1.4)), int(generator.integers(75, 95))
    black, white = np.quantile(share[share > 0.0], (low, high))
    shown = clipped(np.asarray((share - black) / (white - black))) ** gamma
    drawn: Drawn = {"low": low, "high": high, "gamma": gamma, "quality": quality}
    return Processed(compressed(clipped(shown), quality), drawn, bits=8)


def drill_over_rim(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A drill from the side, whose tip ends over the hole or up to 3 mm before it."""
    turn, depth_mm = float(generator.uniform(0.0, 2.0 * np.pi)), float(generator.uniform(-60.0, 40.0))
    offset_mm, diameter = float(generator.uniform(0.2, 1.0)) * (around.rim_mm + 3.0), float(generator.uniform(3.2, 5.0))
    across, _ = axes_across(around.ray, turn)
    tip = around.at_depth(around.middle_mm + offset_mm * across, depth_mm)
    objects = Objects(rods=(rod(tip, tip + 140.0 * across, diameter),))
    drawn: Drawn = {"turn_rad": turn, "offset_mm": offset_mm, "depth_mm": depth_mm, "diameter_mm": diameter}
    return objects, drawn


def clamp(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """Two tapering jaws that open over the nail, one of them across the rim."""
    turn, opening = float(generator.uniform(0.0, 2.0 * np.pi)), float(np.radians(generator.uniform(8.0, 30.0)))
    offset_mm, depth_mm = float(generator.uniform(0.4, 1.2)) * around.rim_mm, float(generator.uniform(-60.0, 40.0))
    across, along = axes_across(around.ray, turn)
    start = around.at_depth(around.middle_mm + offset_mm * across, depth_mm) - 8.0 * along
    hinge = start + 60.0 * along
    second = hinge - 60.0 * (np.cos(opening) * along - np.sin(opening) * across)
    jaws = tuple(
        np.concatenate([tip, (hinge - tip) / 60.0, [0.8, 0.03, 0.0, 60.0]]) for tip in (start, np.asarray(second))
    )
    handle = rod(hinge, hinge + 70.0 * along, 6.0)
    drawn: Drawn = {"turn_rad": turn, "opening_rad": opening, "offset_mm": offset_mm, "depth_mm": depth_mm}
    return Objects(rods=(*jaws, handle)), drawn


def lead_letter(around: Around, generator: np.random.Generator) -> tuple[Objects, Drawn]:
    """A letter L of metal, 8 mm high, within 9 mm of the hole's middle."""
    turn, offset_mm = float(generator.uniform(0.0, 2.0 * np.pi)), float(generator.uniform(3.0, 9.0))
    depth_mm = float(generator.uniform(-90.0, 60.0))
    across, along = axes_across(around.ray, turn)
    corner = around.at_depth(around.middle_mm + offset_mm * across, depth_mm)
    axes = np.array([across, along, around.ray])
    stem = SteelBox(corner + 4.0 * along, axes, np.array([0.8, 4.0, 0.75]))
    foot = SteelBox(corner + 2.5 * across, axes, np.array([2.5, 0.8, 0.75]))
    return Objects(boxes=(stem, foot)), {"turn_rad": turn, "offset_mm": offset_mm, "depth_mm": depth_mm}
