"""A frame as a picture for people: 8 bits, between the grey values that nearly all of its pixels have."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

# Chosen by eye: metal stays black, air white, and JPEG shows no blocks; every fourth pixel is enough for percentiles.
_SHOWN_PERCENTILES: Final = (0.1, 99.9)
_SAMPLED: Final = 4
_JPEG_QUALITY: Final = 85


def jpeg_of(pixels: NDArray[np.float32]) -> bytes:
    """The frame as received, as a JPEG.

    Parameters
    ----------
    pixels
        Grey values, shape (height, width); darker is denser.
    """
    grey = _stretched(pixels, np.percentile(pixels[::_SAMPLED, ::_SAMPLED], _SHOWN_PERCENTILES))
    _, encoded = cv2.imencode(".jpg", grey, (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))
    return bytes(encoded.tobytes())


def grey_8_bits(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Grey values stretched to 8 bits, shape (height, width)."""
    return _stretched(pixels, np.percentile(pixels, _SHOWN_PERCENTILES))


def png_of(grey: NDArray[np.uint8]) -> bytes:
    """Grey values of 8 bits, shape (height, width), as a PNG."""
    _, encoded = cv2.imencode(".png", grey)
    return bytes(encoded.tobytes())


def narrowed(png: bytes, width_px: int) -> bytes:
    """A PNG made so narrow, in its own proportions; one that is narrower already stays as it is."""
    picture = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.shape[1] <= width_px:
        return png
    height, width = picture.shape[:2]
    size = (width_px, max(1, round(height * width_px / width)))
    _, encoded = cv2.imencode(".png", cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    return bytes(encoded.tobytes())


def _stretched(pixels: NDArray[np.float32], ends: NDArray[np.float64]) -> NDArray[np.uint8]:
    low, high = ends
    stretched = (pixels - low) * (255.0 / max(float(high - low), 1e-6))
    return np.asarray(np.clip(stretched, 0.0, 255.0), dtype=np.uint8)
