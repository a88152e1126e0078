"""Synthetic X-rays for imaging's benchmarks: steel spheres, a bent image, a display curve, noise. Truth is exact.

The physics is not the estimator's model: balls attenuate along their chords and are blurred afterwards, while the
estimator fits blurred discs.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from importlib.resources import files

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.parts import RingPart
from shared.parts.files import ring_from_json

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FloatImage = NDArray[np.float32]

SIZE_PX = 1024
PX_PER_MM = 4.37
BLUR_PX = 1.2
ABSORPTION = 3.0
LEFT = 0.6
NAIL_MM, GUIDE_MM = -240.0, -345.0
_SAMPLES = (np.arange(4) - 1.5) / 4.0
_CURVE = 0.65


class Distortion(StrEnum):
    """What bends the image."""

    QUINTIC = "quintic"
    """A random polynomial of order 5."""
    FREE = "free"
    """Pincushion of tangents, a swirl that dies out towards the rim and waves: no polynomial."""
    NONE = "none"


def shipped_ring() -> RingPart:
    """The ring that the product ships."""
    content = (files("shared.parts") / "catalogue" / "ring-120.json").read_bytes()
    return ring_from_json(content, "ring-120.json")


@dataclass(frozen=True, slots=True, eq=False)
class CArm:
    """A C-arm: focal spot in the ring's frame, and how the ring's plane z = 0 appears in the image.

    Attributes
    ----------
    source_mm
        Shape (3,).
    turn_rad
        Rotation of the display.
    coefficients
        Of the polynomial, shape (terms, 2), in pixels; unused otherwise.
    """

    source_mm: Array
    turn_rad: float
    distortion: Distortion
    coefficients: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def image(self, points_mm: Array) -> Array:
        """Pixels, shape (N, 2), of points of the ring's frame, shape (N, 3)."""
        factor = -self.source_mm[2] / (points_mm[:, 2] - self.source_mm[2])
        plane = self.source_mm[:2] + (points_mm[:, :2] - self.source_mm[:2]) * factor[:, None]
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        straight = PX_PER_MM * plane @ np.array([[c, s], [-s, c]])
        return np.asarray(self._bent(straight) + 0.5 * (SIZE_PX - 1) + np.array([3.0, -2.0]))

    def _bent(self, straight: Array) -> Array:
        u = straight / (0.5 * SIZE_PX)
        match self.distortion:
            case Distortion.NONE:
                return straight
            case Distortion.QUINTIC:
                return np.asarray(straight + monomials(u, 5) @ self.coefficients)
            case Distortion.FREE:
                radius = np.hypot(*u.T)[:, None]
                pincushion = straight * (np.tan(0.45 * radius) / (0.45 * np.maximum(radius, 1e-9)) - 1.03)
                swirl = 0.02 * np.exp(-1.5 * radius**2) * straight[:, ::-1] * np.array([1.0, -1.0])
                return np.asarray(straight + pincushion + swirl + 3.0 * np.sin(straight[:, ::-1] / 210.0))


def monomials(points: Array, order: int) -> Array:
    """All monomials of x and y up to an order, shape (N, terms)."""
    x, y = points.T
    return np.stack([x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)], axis=1)


def random_c_arm(rng: np.random.Generator, distortion: Distortion) -> CArm:
    """Draw focal spot and distortion: pincushion of 3-8 %, waves of some pixels."""
    source = np.array([*rng.uniform(-15.0, 15.0, 2), -rng.uniform(900.0, 1030.0)])
    terms = monomials(np.zeros((1, 2)), 5).shape[1]
    powers = np.array([i + j for i in range(6) for j in range(6 - i)])
    coefficients = rng.normal(size=(terms, 2)) * np.array([3.0, 4.0, 4.0, 4.0, 2.0, 2.0])[powers, None]
    return CArm(source, float(rng.uniform(0.0, 2.0 * np.pi)), distortion, coefficients)


def left_over(ring: RingPart, lost: str, rng: np.random.Generator) -> Mask:
    """Which balls are there: 60 %, the others lost at random or, where `lost` is "patch", all around one place."""
    count = len(ring.balls)
    order = rng.permutation(count)
    if lost == "patch":
        place = rng.uniform(-70.0, 70.0, 2)
        order = np.argsort(-np.hypot(*(ring.balls.position_mm[:, :2] - place).T))
    present = np.zeros(count, bool)
    present[order[: round(LEFT * count)]] = True
    return present


@dataclass(frozen=True, slots=True, eq=False)
class Shadow:
    """Balls in an image: centres, shape (N, 2), radii and absorption along the diameter, shape (N,)."""

    centre_px: Array
    radius_px: Array
    absorption: Array

    def select(self, which: NDArray[np.int64] | Mask) -> "Shadow":
        """Those of an index array or mask."""
        return Shadow(self.centre_px[which], self.radius_px[which], self.absorption[which])


def ring_shadow(c_arm: CArm, ring: RingPart) -> Shadow:
    """Shadows of the ring's balls."""
    position = ring.balls.position_mm
    factor = -c_arm.source_mm[2] / (position[:, 2] - c_arm.source_mm[2])
    radius = 0.5 * ring.balls.diameter_mm * PX_PER_MM * factor
    return Shadow(c_arm.image(position), radius, ABSORPTION * ring.balls.diameter_mm / 2.0)


def transmission(shadow: Shadow, shape: tuple[int, int] = (SIZE_PX, SIZE_PX)) -> Array:
    """Light behind the balls, before blur, averaged over 4 x 4 points a pixel."""
    light = np.ones(shape)
    for (x, y), radius, absorption in zip(shadow.centre_px, shadow.radius_px, shadow.absorption, strict=True):
        reach = int(np.ceil(radius)) + 2
        rows = slice(max(round(y) - reach, 0), max(round(y) + reach + 1, 0))
        columns = slice(max(round(x) - reach, 0), max(round(x) + reach + 1, 0))
        part = light[rows, columns]
        if part.size == 0:
            continue
        ys = rows.start + np.arange(part.shape[0])[:, None, None, None] + _SAMPLES[:, None]
        xs = columns.start + np.arange(part.shape[1])[None, :, None, None] + _SAMPLES
        chord = np.sqrt(np.maximum(1.0 - ((xs - x) ** 2 + (ys - y) ** 2) / radius**2, 0.0))
        part *= np.exp(-absorption * chord).mean(axis=(2, 3))
    return light


def displayed(light: Array, blur_px: float = BLUR_PX) -> Array:
    """Blurred, with scatter, through the display's curve."""
    return np.asarray((cv2.GaussianBlur(light, (0, 0), blur_px) + 0.03) ** _CURVE, dtype=np.float64)


def patient(rng: np.random.Generator) -> Array:
    """A leg with a bone and a plank: shades and edges, as transmission."""
    y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX] / SIZE_PX
    light = 0.75 + 0.2 * np.sin(2.0 * x + rng.uniform(0, 6)) * np.cos(1.5 * y)
    middle = 0.5 + 0.06 * np.sin(3.0 * y + rng.uniform(0, 6))
    leg = 0.45 + 0.55 / (1.0 + np.exp((0.22 - np.abs(x - middle)) / 0.02))
    bone = 0.7 + 0.3 / (1.0 + np.exp((0.06 - np.abs(x - middle)) / 0.004))
    plank = np.where((np.abs(x + y - 1.0) < 0.12) & (np.abs(x - y) < 0.2), 0.8, 1.0)
    return np.asarray(light * leg * bone * plank)


@dataclass(frozen=True, slots=True)
class Exposure:
    """Noise and frame of an image.

    Attributes
    ----------
    noise
        Standard deviation of a pixel's grey value, in the units of `displayed`.
    noise_blur_px
        Correlation of the noise; 0 is white.
    aperture_px
        Radius of the round aperture; infinite is a flat panel.
    """

    noise: float
    noise_blur_px: float = 0.0
    aperture_px: float = 484.0


def noise_of(contrast_to_noise: float, light: Array, shadow: Shadow) -> float:
    """Noise of a pixel at which the middle ball's shadow has a contrast-to-noise ratio, in the units of `displayed`.

    Parameters
    ----------
    contrast_to_noise
        Depth of that shadow over the noise.
    light
        Transmission without balls, shape (rows, columns).
    shadow
        The balls; those outside the image do not count.
    """
    x, y = np.round(shadow.centre_px).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < light.shape[1]) & (y < light.shape[0])
    there, absorption = light[y[inside], x[inside]], shadow.absorption[inside]
    depth = (there + 0.03) ** _CURVE - (there * np.exp(-absorption) + 0.03) ** _CURVE
    return float(np.median(depth)) / contrast_to_noise


def exposed(grey: Array, exposure: Exposure, rng: np.random.Generator) -> FloatImage:
    """Add noise, an aperture and burnt-in text, and round to 16 bits."""
    noise = rng.normal(size=grey.shape)
    if exposure.noise_blur_px > 0.0:
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), exposure.noise_blur_px), dtype=np.float64)
    noise *= exposure.noise / noise.std()
    image = 0.7 * (grey + noise) / float(np.quantile(grey, 0.98))
    if np.isfinite(exposure.aperture_px):
        y, x = np.mgrid[0 : grey.shape[0], 0 : grey.shape[1]] - 0.5 * (SIZE_PX - 1)
        image = np.where(np.hypot(x, y) < exposure.aperture_px, image, 0.0)
        text = np.zeros(grey.shape, np.uint8)
        cv2.putText(text, "R 70 kV 1.2 mA  o0O:.", (8, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 255, 2, cv2.LINE_AA)
        image = np.maximum(image, text / 255.0)
    return np.round(np.clip(image, 0.0, 1.0) * 65535.0).astype(np.float32)
