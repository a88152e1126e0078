"""From the primary radiation at each pixel to the detector's signal: scatter, glare, blur, noise, vignetting.

All steps work on the relative signal, shape (rows, columns); nothing here knows what is in the image.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.scenario.imaging_values import Exposure, FlatPanel, Intensifier

Image = NDArray[np.float32]
_COARSE = 8
_BRIGHTEST_SCATTERER = 3.0
_HARSH_RIM_PX = 1.0


def _blur(image: Image, sigma_px: float) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def _wide_blur(image: Image, sigma_px: float) -> Image:
    """Gaussian blur over many pixels, worked out on a coarser grid."""
    size = (max(image.shape[1] // _COARSE, 1), max(image.shape[0] // _COARSE, 1))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), max(sigma_px / _COARSE, 0.5), borderType=cv2.BORDER_REPLICATE)
    wide = cv2.resize(small, (image.shape[1], image.shape[0]), interpolation=cv2.INTER_CUBIC)
    return np.asarray(wide, dtype=np.float32)


def radius_of_pixels(size_px: int) -> Image:
    """Distance of each pixel from the image's middle, shape (size, size), in pixels."""
    line = np.arange(size_px, dtype=np.float32) - 0.5 * (size_px - 1)
    return np.asarray(np.hypot(line[:, None], line[None, :]), dtype=np.float32)


def window(detector: Intensifier | FlatPanel, size_px: int) -> Image:
    """Share of light that the detector's round window lets through, shape (size, size)."""
    if isinstance(detector, FlatPanel):
        return np.ones((size_px, size_px), dtype=np.float32)
    inside = (detector.aperture_radius_px - radius_of_pixels(size_px)) / _HARSH_RIM_PX + 0.5
    return np.asarray(np.clip(inside, 0.0, 1.0), dtype=np.float32)


def with_scatter(primary: Image, exposure: Exposure, pixel_mm: float) -> Image:
    """Add scattered radiation: a broad halo of what passes the patient; open air scatters little."""
    typical = float(np.median(primary))
    source = np.minimum(primary, _BRIGHTEST_SCATTERER * typical)
    return primary + exposure.scatter_to_primary * _wide_blur(source, exposure.scatter_mm / pixel_mm)


def noise_free_signal(primary: Image, detector: Intensifier | FlatPanel, exposure: Exposure, pixel_mm: float) -> Image:
    """Expected quanta per pixel, relative to the open beam, before the detector's blur."""
    total = with_scatter(primary, exposure, pixel_mm)
    if isinstance(detector, FlatPanel):
        return total
    relative = radius_of_pixels(primary.shape[0]) / detector.aperture_radius_px
    return np.asarray(total * (1.0 - exposure.vignetting * relative**2).clip(0.05), dtype=np.float32)


def with_quantum_noise(signal: Image, exposure: Exposure, generator: np.random.Generator) -> Image:
    """Add the noise of counted quanta; `photons_per_px` are counted where the signal is typical."""
    per_signal = exposure.photons_per_px / float(np.median(signal))
    deviation = np.sqrt(signal / per_signal)
    return np.asarray(signal + deviation * generator.standard_normal(signal.shape, dtype=np.float32))


def detected(signal: Image, exposure: Exposure, pixel_mm: float) -> Image:
    """Detector's blur, which also correlates the noise, and the glare of its light."""
    sharp = (1.0 - exposure.tail_share) * _blur(signal, exposure.blur_px)
    sharp = sharp + exposure.tail_share * _blur(signal, exposure.tail_px)
    halo = _wide_blur(sharp, exposure.glare_mm / pixel_mm)
    return np.asarray((1.0 - exposure.glare_share) * sharp + exposure.glare_share * halo, dtype=np.float32)


def with_electronic_noise(signal: Image, exposure: Exposure, generator: np.random.Generator) -> Image:
    """Add white noise after the detector."""
    deviation = np.float32(exposure.electronic_noise * float(np.median(signal)))
    return np.asarray(signal + deviation * generator.standard_normal(signal.shape, dtype=np.float32))


def smeared(signal: Image, length_px: float, generator: np.random.Generator) -> Image:
    """Smear along a random direction, as when somebody moved during the exposure."""
    angle = float(generator.uniform(0.0, np.pi))
    half = int(np.ceil(0.5 * length_px)) + 1
    along = np.linspace(-0.5 * length_px, 0.5 * length_px, 8 * half + 1)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
    for x, y in zip(half + along * np.cos(angle), half + along * np.sin(angle), strict=True):
        i, j = int(y), int(x)
        fx, fy = x - j, y - i
        kernel[i : i + 2, j : j + 2] += np.outer([1 - fy, fy], [1 - fx, fx]).astype(np.float32)
    return np.asarray(cv2.filter2D(signal, -1, kernel / kernel.sum()), dtype=np.float32)
