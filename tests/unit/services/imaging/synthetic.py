"""Synthetic X-rays of a ring: spheres that attenuate, a distorted image, a display curve, noise. Truth is exact."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from services.imaging.core.joint_estimate import on_plane
from shared.geometry.parts import RingPart
from shared.parts.files import ring_from_json
from tests.kept import kept

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]

SIZE_PX = 1024
SCALE_PX_PER_MM = 4.37
APERTURE_PX = 484.0
RING_FILE = Path(__file__).parents[4] / "shared" / "parts" / "catalogue" / "ring-120.json"
_BLUR_PX = 1.2
_ABSORPTION = 3.0


def default_ring() -> RingPart:
    return ring_from_json(RING_FILE.read_bytes(), RING_FILE.name)


@dataclass(frozen=True, slots=True)
class Scene:
    """One image to be made.

    Attributes
    ----------
    source_mm
        Focal spot in the ring's frame.
    turn_deg, mirrored
        How the display turns and reflects the image.
    pincushion, bend_px
        Distortion: relative displacement at the rim, and amplitude of a sine across the image.
    present
        Fraction of the ring's balls that are there.
    others
        Number of other balls, nearer the source.
    noise
        Relative to the brightest grey value.
    """

    seed: int = 1
    source_mm: tuple[float, float, float] = (4.0, -6.0, -968.0)
    turn_deg: float = 30.0
    mirrored: bool = False
    pincushion: float = 0.04
    bend_px: float = 4.0
    aperture: bool = True
    present: float = 1.0
    others: int = 28
    noise: float = 0.005
    curve: float = 0.65
    top: float = 65535.0
    missing: tuple[int, ...] = field(default=())


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """An image with its truth: un-mirrored centres of the ring's and other balls, and which of the ring are there."""

    pixels: FloatImage
    centre_px: Array
    others_px: Array
    present: NDArray[np.bool_]
    source_mm: Array


def to_measured(scene: Scene, plane_mm: Array) -> Array:
    """Measured pixels, un-mirrored, of points of the ring's plane z = 0, shape (N, 2) each."""
    angle = np.deg2rad(scene.turn_deg)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    centre = 0.5 * (SIZE_PX - 1)
    offset = SCALE_PX_PER_MM * plane_mm @ rotation.T
    radius = np.hypot(*offset.T) / (0.5 * SIZE_PX)
    stretched = offset * (1.0 - 0.5 * scene.pincushion + scene.pincushion * radius**2)[:, None]
    bend = scene.bend_px * np.sin(stretched[:, ::-1] / 260.0)
    return np.asarray(stretched + bend + centre + np.array([3.0, -2.0]))


@kept
def render(scene: Scene, ring: RingPart) -> Rendered:
    """Make the image."""
    rng = np.random.default_rng(scene.seed)
    source = np.array(scene.source_mm)
    centre = to_measured(scene, on_plane(ring.balls.position_mm, source))
    depth = -source[2] + ring.balls.position_mm[:, 2]
    radius = 0.5 * ring.balls.diameter_mm * SCALE_PX_PER_MM * -source[2] / depth
    present = rng.random(len(centre)) < scene.present
    present[list(scene.missing)] = False
    light = _background(rng)
    for (x, y), r in zip(centre[present], radius[present], strict=True):
        shade(light, x, y, float(r))
    others = rng.uniform(260.0, 760.0, (scene.others, 2))
    for x, y in others:
        shade(light, x, y, 6.8)
    return _finished(scene, rng, light, Rendered(np.zeros((1, 1), np.float32), centre, others, present, source))


def _background(rng: np.random.Generator) -> Array:
    """Open air, a leg and a plank: smooth shades and edges, as transmission, shape (1024, 1024)."""
    y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX] / SIZE_PX
    light = 0.75 + 0.2 * np.sin(2.0 * x + 1.0) * np.cos(1.5 * y)
    leg = np.abs(x - 0.5 - 0.1 * np.sin(3.0 * y + rng.uniform(0, 6))) < 0.17
    plank = (np.abs(x + y - 1.0) < 0.12) & (np.abs(x - y) < 0.2)
    return np.asarray(light * np.where(leg, 0.6, 1.0) * np.where(plank, 0.75, 1.0))


def shade(light: Array, x: float, y: float, radius: float, absorption: float = _ABSORPTION) -> None:
    """Multiply the transmission of one steel ball into an image; averaged over 4 x 4 points a pixel."""
    reach = int(np.ceil(radius)) + 2
    column, row = round(x), round(y)
    window = (
        slice(max(row - reach, 0), max(row + reach + 1, 0)),
        slice(max(column - reach, 0), max(column + reach + 1, 0)),
    )
    part = light[window]
    if part.size == 0:
        return
    step = (np.arange(4) - 1.5) / 4.0
    ys = window[0].start + np.arange(part.shape[0])[:, None, None, None] + step[:, None]
    xs = window[1].start + np.arange(part.shape[1])[None, :, None, None] + step
    chord = np.sqrt(np.maximum(1.0 - ((xs - x) ** 2 + (ys - y) ** 2) / radius**2, 0.0))
    part *= np.exp(-absorption * chord).mean(axis=(2, 3))


def _finished(scene: Scene, rng: np.random.Generator, light: Array, truth: Rendered) -> Rendered:
    light = np.asarray(cv2.GaussianBlur(light, (0, 0), _BLUR_PX) + 0.03, dtype=np.float64)
    noise = cv2.GaussianBlur(rng.normal(size=light.shape), (0, 0), 0.7)
    grey = (light / light.max()) ** scene.curve + scene.noise * noise / noise.std()
    if scene.aperture:
        y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX] - 0.5 * (SIZE_PX - 1)
        grey = np.where(np.hypot(x, y) < APERTURE_PX, grey, 0.0)
        grey[20:34, 20:120:9] = 0.9  # burnt-in text
    pixels = np.round(np.clip(grey, 0.0, 1.0) * scene.top).astype(np.float32)
    if scene.mirrored:
        pixels = np.ascontiguousarray(pixels[:, ::-1])
    return replace(truth, pixels=pixels)
