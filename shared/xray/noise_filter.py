"""A filter against correlated noise: the detector blurs noise and edges alike, and undoing that makes edges count.

An intensifier's noise is so correlated that its power at the highest frequencies is a hundredth of that at the lowest.
A least-squares fit that treats pixels as independent then underuses an edge: after the filter, which makes the noise
about white, the centres of balls are a fifth more precise.
"""

from typing import TypeVar

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from shared.xray.tuning import NOISE_WHITENING

Scalar = TypeVar("Scalar", bound=np.generic)

# Size of the spectrum, and half of it: a power of two for the transform, long against the noise's correlation.
_BLOCK_PX = 32
_STEP_PX = 16


def noise_whitened(
    pixels: NDArray[np.float32], usable: NDArray[np.bool_], around_px: NDArray[np.float64], margin_px: float
) -> NDArray[np.float32]:
    """The image with the noise around some places made about independent between pixels, elsewhere as it was.

    Parameters
    ----------
    usable
        Where the image shows something, shape of the image.
    around_px
        Places (x, y), shape (N, 2): their bounding box, `margin_px` wider on all sides, is filtered.
    """
    limit = np.array([pixels.shape[1], pixels.shape[0]])
    low = np.clip(np.floor(around_px.min(axis=0) - margin_px), 0, limit).astype(int)
    high = np.clip(np.ceil(around_px.max(axis=0) + margin_px), 0, limit).astype(int)
    box = (slice(low[1], high[1]), slice(low[0], high[0]))
    blocks = _flat_blocks(pixels[box], usable[box])
    if len(blocks) < NOISE_WHITENING.least_blocks:
        return pixels
    out = pixels.copy()
    filtered = cv2.filter2D(pixels[box], cv2.CV_32F, _kernel(_power(blocks)), borderType=cv2.BORDER_REFLECT)
    out[box] = filtered
    return out


def _flat_blocks(pixels: NDArray[np.float32], usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Residuals of the blocks with the least structure after a quadratic has been taken off, shape (K, 32, 32)."""
    if min(pixels.shape) < _BLOCK_PX:
        return np.zeros((0, _BLOCK_PX, _BLOCK_PX))
    clipped = (pixels == pixels.max()) | (pixels == pixels.min())
    suitable = _blocks_of(usable).all(axis=(2, 3)) & (
        _blocks_of(clipped).mean(axis=(2, 3)) <= NOISE_WHITENING.most_clipped
    )
    blocks = _blocks_of(pixels)[suitable].reshape(-1, _BLOCK_PX * _BLOCK_PX)
    # of large grey values, single precision would hold little but their mean
    blocks = blocks - blocks.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
    basis = _quadratics()
    smooth = blocks @ basis.astype(np.float32)
    structure = np.einsum("kp,kp->k", blocks, blocks) - np.einsum("kt,kt->k", smooth, smooth)
    flattest = np.argsort(structure)[: max(NOISE_WHITENING.least_blocks, int(NOISE_WHITENING.flattest * len(blocks)))]
    chosen = blocks[flattest].astype(np.float64)
    return np.asarray(chosen - chosen @ basis @ basis.T).reshape(-1, _BLOCK_PX, _BLOCK_PX)


def _blocks_of(picture: NDArray[Scalar]) -> NDArray[Scalar]:
    """Overlapping blocks of a picture, a view of shape (down, across, 32, 32)."""
    return sliding_window_view(picture, (_BLOCK_PX, _BLOCK_PX))[::_STEP_PX, ::_STEP_PX]


def _quadratics() -> NDArray[np.float64]:
    """Orthonormal basis of the quadratic polynomials on a block, shape (pixels, 6)."""
    x = np.linspace(-1.0, 1.0, _BLOCK_PX)
    X, Y = (grid.ravel() for grid in np.meshgrid(x, x))
    return np.asarray(np.linalg.qr(np.stack([np.ones_like(X), X, Y, X * X, X * Y, Y * Y], axis=1))[0])


def _power(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Power spectrum of the noise relative to slow frequencies, at most 1, the same in all directions."""
    window = np.outer(np.hanning(_BLOCK_PX), np.hanning(_BLOCK_PX))
    spectrum = np.mean(np.abs(np.fft.rfft2(blocks * window)) ** 2, axis=0)
    frequency = _frequency()
    ring = (frequency / NOISE_WHITENING.ring_width).astype(int)
    sums, counts = np.bincount(ring.ravel(), spectrum.ravel()), np.bincount(ring.ravel())
    middle = (np.arange(len(counts)) + 0.5) * NOISE_WHITENING.ring_width
    filled = counts > 0
    by_ring = sums[filled] / counts[filled]
    slow = (middle[filled] > NOISE_WHITENING.slow) & (middle[filled] < NOISE_WHITENING.slow_end)
    relative = np.minimum(by_ring / by_ring[slow].mean(), 1.0)
    power = np.interp(frequency, middle[filled], relative)
    power[frequency < NOISE_WHITENING.slow] = 1.0
    return np.asarray(power)


def _kernel(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Short filter whose response is the inverse root of the power, gain one for slow variations."""
    impulse = np.fft.fftshift(np.fft.irfft2((power + NOISE_WHITENING.least_power) ** -0.5, (_BLOCK_PX, _BLOCK_PX)))
    middle, reach = _BLOCK_PX // 2, NOISE_WHITENING.kernel_reach_px
    inner = impulse[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
    lags = np.arange(-reach, reach + 1)
    distance = np.minimum(np.hypot(lags[:, None], lags[None, :]) / (reach + 1), 1.0)
    inner = inner * np.cos(0.5 * np.pi * distance) ** 2
    return np.asarray(inner / inner.sum())


def _frequency() -> NDArray[np.float64]:
    """Frequency of each place of a block's half spectrum, in cycles per pixel, shape (32, 17)."""
    return np.asarray(np.hypot(np.fft.fftfreq(_BLOCK_PX)[:, None], np.fft.rfftfreq(_BLOCK_PX)[None, :]))
