"""Primary radiation at each pixel: one ray for each, and many where neighbours differ."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.render import detector
from simulation.render.attenuation import Spectrum, spectrum
from simulation.render.distortion import ideal_from_measured
from simulation.render.tracer import PackedScene, refine_pixels, trace_pixels, trace_rows
from simulation.scenario.values import Scenario
from simulation.world.poses import World

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
T = TypeVar("T")
_THREADS = 2
# With their mirror images each column takes every sixteenth of the range once, and the columns hardly correlate (0.13).
_SPREAD_32NDS = np.array(
    [
        [9, -9, -13, -3],
        [-13, -11, 9, -1],
        [-15, -5, -15, 7],
        [5, 1, 11, 9],
        [11, -3, 1, 15],
        [-3, 7, 5, -5],
        [-1, -13, 3, 13],
        [7, -15, 7, -11],
    ],
    dtype=np.float64,
)
_EDGE = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class Traced:
    """The rays of one image, and what they were traced through.

    Attributes
    ----------
    targets_mm
        Where each pixel lies on the detector, shape (rows, columns, 2).
    middle, share
        Signal of the ray through each pixel's middle, and the spongy bone's mineral share on it, (rows, columns).
    primary
        Primary radiation, relative to the open beam, (rows, columns): `middle`, refined at edges.
    """

    scene: PackedScene
    targets_mm: Floats
    middle: Image
    share: Image
    primary: Image


def trace(scenario: Scenario, world: World, scene: PackedScene) -> Traced:
    """Trace all rays.

    One ray per pixel first; where neighbours differ, the mean of rays spread over the pixel and the focal spot.
    """
    beam = beam_of(scenario)
    size = scenario.c_arm.size_px
    rows, columns = np.mgrid[0:size, 0:size].astype(np.float64)
    targets = detector_points_mm(scenario, world, np.stack([columns, rows], axis=-1))
    parts = _side_by_side(
        size,
        lambda first, last: trace_rows(scene, first, targets[first:last], beam.weight, beam.attenuation_per_mm),
    )
    middle = np.concatenate([signal for signal, _ in parts])
    share = np.concatenate([share for _, share in parts])
    return _refined(scenario, Traced(scene, targets, middle, share, middle.copy()), np.ones((size, size), np.bool_))


def trace_again(scenario: Scenario, before: Traced, scene: PackedScene, where: Mask) -> Traced:
    """The rays of some pixels through another scene; all others are as they were."""
    beam, pixels = beam_of(scenario), np.argwhere(where)
    parts = _side_by_side(
        len(pixels),
        lambda first, last: trace_pixels(
            scene,
            pixels[first:last],
            before.targets_mm[where][first:last],
            beam.weight,
            beam.attenuation_per_mm,
        ),
    )
    middle, share, primary = before.middle.copy(), before.share.copy(), before.primary.copy()
    middle[where] = np.concatenate([signal for signal, _ in parts])
    share[where] = np.concatenate([share for _, share in parts])
    primary[where] = middle[where]
    return _refined(scenario, Traced(scene, before.targets_mm, middle, share, primary), where)


def beam_of(scenario: Scenario) -> Spectrum:
    """The beam's spectrum."""
    return spectrum(scenario.exposure.tube_voltage_kv, scenario.exposure.filtration_mm_aluminium)


def detector_points_mm(scenario: Scenario, world: World, measured_px: Floats) -> Floats:
    """Where measured pixels, shape (..., 2), lie on the detector plane of the beam's frame, shape (..., 2), in mm."""
    c = scenario.c_arm
    ideal = ideal_from_measured(scenario.detector, measured_px, c.size_px, c.pixel_mm, world.rotation_deg)
    return (ideal - world.intrinsic_matrix_px[:2, 2]) * c.pixel_mm


def ray_samples(focal_spot_mm: float) -> Floats:
    """Places in the pixel (px from its middle) and on the focal spot (mm), shape (samples, 4), with mean zero."""
    spread = np.concatenate([_SPREAD_32NDS, -_SPREAD_32NDS]) / 32.0
    return np.asarray(spread * np.array([1.0, 1.0, focal_spot_mm, focal_spot_mm]))


def _refined(scenario: Scenario, rays: Traced, where: Mask) -> Traced:
    """The same with the mean over each pixel's area and the focal spot at those of some pixels that are at edges."""
    lit = detector.window(scenario.detector, scenario.c_arm.size_px) > 0.0
    pixels = np.argwhere(_edges(rays.middle) & lit & where)
    at = (pixels[:, 0], pixels[:, 1])
    beam, samples = beam_of(scenario), ray_samples(scenario.exposure.focal_spot_mm)
    middles, shares = rays.targets_mm[at], rays.share[at].astype(np.float64)
    steps = np.stack([_step_at(rays.targets_mm, pixels, axis) for axis in (1, 0)], axis=1)
    parts = _side_by_side(
        len(pixels),
        lambda first, last: refine_pixels(
            rays.scene,
            pixels[first:last],
            middles[first:last],
            steps[first:last],
            samples,
            shares[first:last],
            beam.weight,
            beam.attenuation_per_mm,
        ),
    )
    rays.primary[at] = np.concatenate(parts)
    return rays


def _step_at(targets_mm: Floats, pixels: Integers, axis: int) -> Floats:
    """What `numpy.gradient` gives along an axis at some pixels, shape (N, 2)."""
    before, after = pixels.copy(), pixels.copy()
    before[:, axis] = np.maximum(pixels[:, axis] - 1, 0)
    after[:, axis] = np.minimum(pixels[:, axis] + 1, targets_mm.shape[axis] - 1)
    difference = targets_mm[tuple(after.T)] - targets_mm[tuple(before.T)]
    return np.asarray(difference / (after[:, axis] - before[:, axis])[:, None])


def _side_by_side(count: int, work: Callable[[int, int], T]) -> list[T]:
    """Share `count` rows or pixels among a few threads; `work` gets the first and the end of its share."""
    ends = np.linspace(0, count, 2 * _THREADS + 1).astype(int)
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(work, ends[:-1].tolist(), ends[1:].tolist()))


def _edges(primary: Image) -> Mask:
    """Pixels next to which the signal bends or steps: a mere gradient is the same at the middle as on the average."""
    window = np.ones((3, 3), np.uint8)
    bend = np.abs(cv2.dilate(primary, window) + cv2.erode(primary, window) - 2.0 * primary)
    # Twice, because the focal spot's penumbra reaches beyond the edge.
    return np.asarray(cv2.dilate((bend > _EDGE * primary).astype(np.uint8), window) > 0)
