"""What displays do to grey values, place by place or around each: windows, curves, contrast, edges, filters, JPEG.

Every operator takes the image as shares of full scale, shape (rows, columns), and a generator for its parameters.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.scene import Drawn

Grey: TypeAlias = NDArray[np.float32]
_LAPLACIAN_LEVELS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Processed:
    """A processed image as shares of full scale, the drawn parameters, and its bits (None: those that it had)."""

    share: Grey
    drawn: Drawn
    bits: int | None = None


Operator: TypeAlias = Callable[[Grey, np.random.Generator], Processed]


def black_cut_off(share: Grey, generator: np.random.Generator) -> Processed:
    """Black is put at the 0.5 to 5 % quantile of the grey values in the visible field."""
    quantile = float(generator.uniform(0.005, 0.05))
    black = float(np.quantile(share[share > 0.0], quantile))
    return Processed(clipped((share - black) / (1.0 - black)), {"quantile": quantile})


def white_cut_off(share: Grey, generator: np.random.Generator) -> Processed:
    """White is put at the 85 to 99.5 % quantile of the grey values."""
    quantile = float(generator.uniform(0.85, 0.995))
    return Processed(clipped(share / np.quantile(share, quantile)), {"quantile": quantile})


def gamma_curve(share: Grey, generator: np.random.Generator) -> Processed:
    """Grey values to the power of 0.5 to 2."""
    gamma = float(np.exp(generator.uniform(np.log(0.5), np.log(2.0))))
    return Processed(clipped(share**gamma), {"gamma": gamma})


def s_curve(share: Grey, generator: np.random.Generator) -> Processed:
    """A logistic curve that maps black to black and white to white."""
    slope, centre = float(generator.uniform(3.0, 8.0)), float(generator.uniform(0.35, 0.65))
    low, high, curve = (1.0 / (1.0 + np.exp(-slope * (x - centre))) for x in (0.0, 1.0, share))
    return Processed(clipped((curve - low) / (high - low)), {"slope": slope, "centre": centre})


def local_contrast(share: Grey, generator: np.random.Generator) -> Processed:
    """CLAHE with a clip limit of 1 to 4 and 2 to 16 tiles across, on 8 bits as displays have them."""
    clip, tiles = float(generator.uniform(1.0, 4.0)), int(generator.choice([2, 4, 8, 16]))
    return Processed(_clahe(share, clip, tiles), {"clip": clip, "tiles": tiles}, bits=8)


def unsharp_mask(share: Grey, generator: np.random.Generator) -> Processed:
    """Unsharp mask with a gain of 0.3 to 2 and a radius of 0.8 to 4 px."""
    gain, sigma_px = float(generator.uniform(0.3, 2.0)), float(generator.uniform(0.8, 4.0))
    return Processed(_sharpened(share, gain, sigma_px), {"gain": gain, "sigma_px": sigma_px})


def multi_scale(share: Grey, generator: np.random.Generator) -> Processed:
    """Laplacian pyramid: each level with a gain of 0.8 to 2.2 and its amplitudes to the power of 0.7 to 1."""
    gains = generator.uniform(0.8, 2.2, _LAPLACIAN_LEVELS)
    power = float(generator.uniform(0.7, 1.0))
    residual: NDArray[np.floating] = share
    details: list[NDArray[np.floating]] = []
    for _ in gains:
        smaller = np.asarray(cv2.pyrDown(residual), dtype=np.float32)
        details.append(residual - cv2.pyrUp(smaller, dstsize=residual.shape[::-1]))
        residual = smaller
    for gain, detail in zip(gains[::-1], details[::-1], strict=True):
        largest = float(np.abs(detail).max()) + 1e-9
        enhanced = gain * largest * np.sign(detail) * (np.abs(detail) / largest) ** power
        residual = np.asarray(cv2.pyrUp(residual, dstsize=detail.shape[::-1])) + enhanced.astype(np.float32)
    drawn: Drawn = {f"gain_{k}": float(gain) for k, gain in enumerate(gains)}
    return Processed(clipped(residual), drawn | {"power": power})


def bilateral_filter(share: Grey, generator: np.random.Generator) -> Processed:
    """Bilateral filter of 1.5 to 4 px and 2 to 8 % of full scale: smooth but for edges."""
    space_px, range_share = float(generator.uniform(1.5, 4.0)), float(generator.uniform(0.02, 0.08))
    smooth = np.asarray(cv2.bilateralFilter(share, -1, range_share, space_px), dtype=np.float32)
    return Processed(clipped(smooth), {"space_px": space_px, "range_share": range_share})


def non_local_means(share: Grey, generator: np.random.Generator) -> Processed:
    """Non-local means of strength 3 to 10 on 8 bits: patches that resemble one another are averaged."""
    strength, search_px = float(generator.uniform(3.0, 10.0)), int(generator.choice([11, 15, 21]))
    smooth = cv2.fastNlMeansDenoising(_as_bytes(share), None, strength, 5, search_px)
    return Processed(_from_bytes(smooth), {"strength": strength, "search_px": search_px}, bits=8)


def median_filter(share: Grey, generator: np.random.Generator) -> Processed:
    """Median over 3 or 5 pixels."""
    size = int(generator.choice([3, 5]))
    return Processed(np.asarray(cv2.medianBlur(share, size), dtype=np.float32), {"size_px": size})


def gaussian_blur(share: Grey, generator: np.random.Generator) -> Processed:
    """A Gaussian of 0.8 to 4 px over image and noise."""
    sigma_px = float(generator.uniform(0.8, 4.0))
    return Processed(cv2.GaussianBlur(share, (0, 0), sigma_px).astype(np.float32), {"sigma_px": sigma_px})


def jpeg(share: Grey, generator: np.random.Generator) -> Processed:
    """JPEG of quality 70 to 95."""
    quality = int(generator.integers(70, 96))
    return Processed(compressed(share, quality), {"quality": quality}, bits=8)


def monitor_chain(share: Grey, generator: np.random.Generator) -> Processed:
    """CLAHE, sharpening and JPEG of quality 85, one after another."""
    clip, gain, sigma_px = (float(generator.uniform(*ends)) for ends in ((1.5, 3.0), (0.5, 1.0), (1.0, 2.0)))
    shown = compressed(_sharpened(_clahe(share, clip, 8), gain, sigma_px), 85)
    return Processed(shown, {"clip": clip, "gain": gain, "sigma_px": sigma_px}, bits=8)


def half_size(share: Grey, _: np.random.Generator) -> Processed:
    """Half as many rows and columns."""
    smaller = cv2.resize(share, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return Processed(np.asarray(smaller, dtype=np.float32), {"factor": 0.5})


def six_bits(share: Grey, _: np.random.Generator) -> Processed:
    """64 grey values."""
    return Processed(np.asarray(np.rint(share * 63.0) / 63.0, dtype=np.float32), {"bits": 6})


def clipped(share: NDArray[np.floating]) -> Grey:
    """Within black and white."""
    return np.asarray(np.clip(share, 0.0, 1.0), dtype=np.float32)


def _as_bytes(share: Grey) -> NDArray[np.uint8]:
    return np.asarray(np.rint(255.0 * share), dtype=np.uint8)


def _from_bytes(image: NDArray[np.generic]) -> Grey:
    return np.asarray(image, dtype=np.float32) / np.float32(255.0)


def _clahe(share: Grey, clip: float, tiles: int) -> Grey:
    return _from_bytes(np.asarray(cv2.createCLAHE(clip, (tiles, tiles)).apply(_as_bytes(share))))


def _sharpened(share: Grey, gain: float, sigma_px: float) -> Grey:
    return clipped(share + gain * (share - cv2.GaussianBlur(share, (0, 0), sigma_px)))


def compressed(share: Grey, quality: int) -> Grey:
    """What JPEG of a quality leaves."""
    written, code = cv2.imencode(".jpg", _as_bytes(share), [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert written
    return _from_bytes(np.asarray(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE)))
