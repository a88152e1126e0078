"""One X-ray image of the virtual operating room, from a scenario and a state to grey values and exact truth."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.render import detector, display
from simulation.render.attenuation import Material, Spectrum, spectrum
from simulation.render.distortion import ideal_from_measured
from simulation.render.scene import BallsInView, balls_in_view, pack_scene
from simulation.render.tracer import PackedScene, refine_pixels, trace_lengths, trace_rows
from simulation.render.truth import ImageTruth, image_truth
from simulation.scenario.values import Scenario
from simulation.world.poses import World, WorldState, world_at

Floats = NDArray[np.float64]
Image = NDArray[np.float32]
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


class Noise(StrEnum):
    """Whether an image has quantum and electronic noise; `OPPOSITE`: that of the same shot with its sign changed."""

    REAL = "real"
    OPPOSITE = "opposite"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class ImageFaults:
    """What may be wrong with a shot.

    Attributes
    ----------
    dose_factor
        Share of the usual quanta.
    motion_blur_px
        Length of the smear, along a random direction.
    overexposure
        The display's white level is multiplied by this: above 1, light areas saturate.
    """

    dose_factor: float = 1.0
    motion_blur_px: float = 0.0
    overexposure: float = 1.0


NO_FAULTS = ImageFaults()


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An image as the C-arm sends it, and the truth about it."""

    pixels: display.Grey
    truth: ImageTruth
    world: World = field(repr=False)


def render_scene(
    scenario: Scenario,
    state: WorldState,
    shot_number: int = 0,
    noise: Noise = Noise.REAL,
    faults: ImageFaults = NO_FAULTS,
) -> Shot:
    """Take one X-ray image.

    Parameters
    ----------
    shot_number
        Seeds the noise together with the scenario's seed.

    Returns
    -------
    Shot
        Grey values, shape (rows, columns), 8 or 16 bits, and the truth.
    """
    return exposed(scenario, view_of(scenario, state), shot_number, noise, faults)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What every exposure from one place of the C-arm shares: all but noise and faults.

    Attributes
    ----------
    primary
        Primary radiation at each pixel, relative to the open beam, shape (rows, columns).
    """

    world: World
    primary: Image
    truth: ImageTruth


def view_of(scenario: Scenario, state: WorldState) -> View:
    """Trace the rays once; running fluoroscopy makes many exposures of them."""
    world = world_at(scenario, state)
    balls = balls_in_view(scenario, world)
    packed = pack_scene(scenario, world, balls)
    window = detector.window(scenario.detector, scenario.c_arm.size_px)
    truth = image_truth(scenario, world, balls, window, metal_behind_mm(packed, balls))
    return View(world, trace_primary(scenario, world, packed), truth)


def exposed(scenario: Scenario, view: View, shot_number: int, noise: Noise, faults: ImageFaults) -> Shot:
    """One exposure of a view, as `render_scene`."""
    generator = np.random.default_rng([scenario.seed, shot_number, 0x5107])
    signal = _signal(scenario, view.primary, noise, faults, generator)
    window = detector.window(scenario.detector, scenario.c_arm.size_px)
    shown = replace(scenario.display, white_level=scenario.display.white_level * faults.overexposure)
    grey = display.grey_values(shown, signal, window)
    return Shot(display.as_shown(shown, grey), view.truth, view.world)


def detector_points_mm(scenario: Scenario, world: World, measured_px: Floats) -> Floats:
    """Where measured pixels, shape (..., 2), lie on the detector plane of the beam's frame, shape (..., 2), in mm."""
    c = scenario.c_arm
    ideal = ideal_from_measured(scenario.detector, measured_px, c.size_px, c.pixel_mm, world.rotation_deg)
    return (ideal - world.intrinsic_matrix_px[:2, 2]) * c.pixel_mm


def trace_primary(scenario: Scenario, world: World, packed: PackedScene) -> Image:
    """Primary radiation at each pixel, relative to the open beam, shape (rows, columns).

    One ray per pixel first; where neighbours differ, the mean of rays spread over the pixel and the focal spot.
    """
    beam = spectrum(scenario.exposure.tube_voltage_kv, scenario.exposure.filtration_mm_aluminium)
    size = scenario.c_arm.size_px
    rows, columns = np.mgrid[0:size, 0:size].astype(np.float64)
    targets = detector_points_mm(scenario, world, np.stack([columns, rows], axis=-1))
    parts = _side_by_side(
        size,
        lambda first, last: trace_rows(packed, first, targets[first:last], beam.weight, beam.attenuation_per_mm),
    )
    primary = np.concatenate([signal for signal, _ in parts])
    share = np.concatenate([share for _, share in parts])
    edges = np.argwhere(_edges(primary) & (detector.window(scenario.detector, size) > 0.0))
    primary[tuple(edges.T)] = _refined(scenario, packed, targets, edges, share, beam)
    return primary


def _refined(
    scenario: Scenario, packed: PackedScene, targets: Floats, pixels: NDArray[np.int64], share: Image, beam: Spectrum
) -> Floats:
    """Signal of some pixels, shape (N,), as the mean over each pixel's area and the focal spot."""
    at = (pixels[:, 0], pixels[:, 1])
    steps = np.stack([np.gradient(targets, axis=1)[at], np.gradient(targets, axis=0)[at]], axis=1)
    middles, shares = targets[at], share[at].astype(np.float64)
    samples = ray_samples(scenario.exposure.focal_spot_mm)
    parts = _side_by_side(
        len(pixels),
        lambda first, last: refine_pixels(
            packed,
            pixels[first:last],
            middles[first:last],
            steps[first:last],
            samples,
            shares[first:last],
            beam.weight,
            beam.attenuation_per_mm,
        ),
    )
    return np.concatenate(parts)


def _side_by_side(count: int, work: Callable[[int, int], T]) -> list[T]:
    """Share `count` rows or pixels among a few threads; `work` gets the first and the end of its share."""
    ends = np.linspace(0, count, 2 * _THREADS + 1).astype(int)
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(work, ends[:-1].tolist(), ends[1:].tolist()))


def _edges(primary: Image) -> NDArray[np.bool_]:
    """Pixels next to which the signal bends or steps: a mere gradient is the same at the middle as on the average."""
    window = np.ones((3, 3), np.uint8)
    bend = np.abs(cv2.dilate(primary, window) + cv2.erode(primary, window) - 2.0 * primary)
    # Twice, because the focal spot's penumbra reaches beyond the edge.
    return np.asarray(cv2.dilate((bend > _EDGE * primary).astype(np.uint8), window) > 0)


def ray_samples(focal_spot_mm: float) -> Floats:
    """Places in the pixel (px from its middle) and on the focal spot (mm), shape (samples, 4), with mean zero."""
    spread = np.concatenate([_SPREAD_32NDS, -_SPREAD_32NDS]) / 32.0
    return np.asarray(spread * np.array([1.0, 1.0, focal_spot_mm, focal_spot_mm]))


def metal_behind_mm(packed: PackedScene, balls: BallsInView) -> Floats:
    """Path through metal other than balls on the ray to each ball's centre, shape (N,), in mm."""
    scale = packed.detector_distance_mm / balls.centre_mm[:, 2]
    targets = np.ascontiguousarray(balls.centre_mm[:, :2] * scale[:, None])
    lengths = trace_lengths(packed, targets, np.full(len(targets), -1))
    return np.asarray(lengths[:, Material.TITANIUM] + lengths[:, Material.STEEL])


def _signal(
    scenario: Scenario, primary: Image, noise: Noise, faults: ImageFaults, generator: np.random.Generator
) -> Image:
    """From primary radiation to the detector's signal."""
    pixel_mm = scenario.c_arm.pixel_mm
    exposure = replace(scenario.exposure, photons_per_px=scenario.exposure.photons_per_px * faults.dose_factor)
    expected = detector.noise_free_signal(primary, scenario.detector, exposure, pixel_mm)
    if faults.motion_blur_px > 0.0:
        expected = detector.smeared(expected, faults.motion_blur_px, generator)
    if noise is Noise.NONE:
        return detector.detected(expected, exposure, pixel_mm)
    counted = _signed(noise, expected, detector.with_quantum_noise(expected, exposure, generator))
    seen = detector.detected(counted, exposure, pixel_mm)
    return _signed(noise, seen, detector.with_electronic_noise(seen, exposure, generator))


def _signed(noise: Noise, expected: Image, noisy: Image) -> Image:
    return 2.0 * expected - noisy if noise is Noise.OPPOSITE else noisy
