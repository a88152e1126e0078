"""One X-ray image of the virtual operating room, from a scenario and a state to grey values and exact truth."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from simulation.render import detector, display
from simulation.render.attenuation import Material
from simulation.render.primary import Image
from simulation.render.retracing import Retracing
from simulation.render.scene import BallsInView, balls_in_view, pack_scene
from simulation.render.tracer import PackedScene, trace_lengths
from simulation.render.truth import ImageTruth, image_truth
from simulation.scenario.values import Scenario
from simulation.world.poses import World, WorldState, world_at

Floats = NDArray[np.float64]
ChangePacked: TypeAlias = Callable[[PackedScene, World], PackedScene]


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
    retracing: Retracing | None = None,
) -> Shot:
    """Take one X-ray image.

    Parameters
    ----------
    shot_number
        Seeds the noise together with the scenario's seed.
    retracing
        See `view_of`.

    Returns
    -------
    Shot
        Grey values, shape (rows, columns), 8 or 16 bits, and the truth.
    """
    return exposed(scenario, view_of(scenario, state, retracing), shot_number, noise, faults)


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


def view_of(
    scenario: Scenario,
    state: WorldState,
    retracing: Retracing | None = None,
    change: ChangePacked = lambda packed, _: packed,
) -> View:
    """Trace the rays once; running fluoroscopy makes many exposures of them.

    Parameters
    ----------
    retracing
        Keeps rays from image to image of one room.
    change
        Changes what the X-rays meet.
    """
    world = world_at(scenario, state)
    balls = balls_in_view(scenario, world)
    packed = change(pack_scene(scenario, world, balls), world)
    window = detector.window(scenario.detector, scenario.c_arm.size_px)
    truth = image_truth(scenario, world, balls, window, metal_behind_mm(packed, balls))
    return View(world, (retracing or Retracing()).primary(scenario, world, packed), truth)


def exposed(scenario: Scenario, view: View, shot_number: int, noise: Noise, faults: ImageFaults) -> Shot:
    """One exposure of a view, as `render_scene`."""
    generator = np.random.default_rng([scenario.seed, shot_number, 0x5107])
    signal = _signal(scenario, view.primary, noise, faults, generator)
    window = detector.window(scenario.detector, scenario.c_arm.size_px)
    shown = replace(scenario.display, white_level=scenario.display.white_level * faults.overexposure)
    grey = display.grey_values(shown, signal, window)
    return Shot(display.as_shown(shown, grey), view.truth, view.world)


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
