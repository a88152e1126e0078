"""Noise as the residuals show it: its variance by brightness, its correlation between pixels, and a filter against it.

X-ray noise is blurred by the detector together with the picture, so that neighbouring pixels err together: a fit that
takes them for independent weighs blurred and sharp detail wrongly and believes its own errors to be three times
smaller than they are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from services.registration.core.nail.imaging_chain import Real
from shared.two_cores import mapped

_LAGS = 9
_TAPER_PX = 8.0
_FILTER_REACH_PX = 9.0
_PADDING = 9
_LOWEST_FREQUENCY = 0.06
# Limits the filter's gain at the highest frequencies to about 22.
_NOISE_FLOOR = 0.002
_BRIGHTNESS_CLASSES = 12
_OUTLIER_DEVIATIONS = 3.0
MEDIAN_TO_DEVIATION = 1.4826


@dataclass(frozen=True, slots=True, eq=False)
class NoiseCorrelation:
    """Correlation of standardised residuals between pixels up to 9 apart, shape (19, 19), 1 in the middle."""

    by_lag: NDArray[np.float64]

    @property
    def inflation(self) -> float:
        """By how much the variance of a mean over many pixels exceeds that of independent ones (at least 1)."""
        return max(1.0, float((self.by_lag * _taper(_LAGS, _TAPER_PX)).sum()))

    def spectrum(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Power by frequency, never negative, the same in all directions: half spectrum of a rectangle of a shape."""
        kernel = np.zeros(shape)
        lags = np.arange(-_LAGS, _LAGS + 1)
        kernel[np.ix_(lags, lags)] = _isotropic(self.by_lag) * _taper(_LAGS, _TAPER_PX)
        return np.maximum(fft.rfft2(kernel).real, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class WhiteningFilter:
    """Short symmetric filters, gain one for slow variations, that make the noise about independent between pixels.

    Where metal stops the quanta the electronics' noise remains, which no blur has correlated: dark and bright places
    need a filter each.

    Attributes
    ----------
    dark, bright
        Spectra of the two filters on the padded rectangle, packed as OpenCV packs those of real pictures.
    brightness
        Share of the bright one in each pixel's filter, shape (rows, columns).
    """

    dark: NDArray[np.float32]
    bright: NDArray[np.float32]
    brightness: NDArray[np.float32]

    def after(self, earlier: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> "WhiteningFilter":
        """What a symmetric filter and then this one do, in one, but for a rim of the picture.

        There, beyond the padding, this one's spectrum wraps round, while the filters one by one repeat edge values.

        Parameters
        ----------
        earlier
            That filter, of a picture of any size; far shorter than the picture.
        """
        rows, columns = self.dark.shape
        impulse = np.zeros((rows, columns), dtype=np.float32)
        impulse[rows // 2, columns // 2] = 1.0
        before = cv2.dft(np.roll(earlier(impulse), (-(rows // 2), -(columns // 2)), axis=(0, 1)))
        dark, bright = (cv2.mulSpectrums(own, before, 0) for own in (self.dark, self.bright))
        return WhiteningFilter(
            np.asarray(dark, dtype=np.float32), np.asarray(bright, dtype=np.float32), self.brightness
        )

    def apply(self, picture: NDArray[Real]) -> NDArray[np.float32]:
        """Filter a picture, shape (rows, columns), edge values repeated beyond its border."""
        picture = picture.astype(np.float32, copy=False)
        rows, columns = picture.shape
        here = slice(_PADDING, _PADDING + rows), slice(_PADDING, _PADDING + columns)
        below, beside = self.dark.shape[0] - rows - _PADDING, self.dark.shape[1] - columns - _PADDING
        spectrum = cv2.dft(cv2.copyMakeBorder(picture, _PADDING, below, _PADDING, beside, cv2.BORDER_REPLICATE))
        dark, bright = (
            cv2.idft(cv2.mulSpectrums(spectrum, response, 0), flags=cv2.DFT_SCALE)[here]
            for response in (self.dark, self.bright)
        )
        return np.asarray(dark + self.brightness * (bright - dark))


def noise_correlation(
    standardised: NDArray[np.float64], places: NDArray[np.int64], shape: tuple[int, int]
) -> NoiseCorrelation:
    """Correlation of residuals, shape (N,), at flat places, shape (N,), of a rectangle."""
    # single precision is plenty: sums of tens of thousands of squares, to a part in a million
    values, present = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
    values.ravel()[places], present.ravel()[places] = standardised, 1.0
    padded = tuple(fft.next_fast_len(side + 2 * _LAGS, real=True) for side in shape)
    sums = fft.irfft2(np.abs(fft.rfft2(values, padded)) ** 2, padded)
    counts = fft.irfft2(np.abs(fft.rfft2(present, padded)) ** 2, padded)
    lags = np.arange(-_LAGS, _LAGS + 1)
    by_lag = sums[np.ix_(lags, lags)].astype(np.float64) / np.maximum(counts[np.ix_(lags, lags)], 1.0)
    return NoiseCorrelation(by_lag / by_lag[_LAGS, _LAGS])


def whitening_filter(
    dark: NoiseCorrelation, bright: NoiseCorrelation, brightness: NDArray[np.float64]
) -> WhiteningFilter:
    """Filters whose responses are the inverse roots of the noise's power spectra, the same in all directions."""
    rows, columns = (cv2.getOptimalDFTSize(side + 2 * _PADDING) for side in brightness.shape)
    of_dark, of_bright = mapped(lambda kind: _response(kind, (rows, columns)), (dark, bright), 2)
    return WhiteningFilter(of_dark, of_bright, brightness.astype(np.float32))


def _response(correlation: NoiseCorrelation, padded_shape: tuple[int, int]) -> NDArray[np.float32]:
    rows, columns = padded_shape
    power = correlation.spectrum(padded_shape)
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :])
    slow = frequency < _LOWEST_FREQUENCY
    level = float(power[slow].mean())
    # slow residuals are texture as much as noise: the filter must not act on them
    power[slow] = level
    impulse = fft.irfft2((power / level + _NOISE_FLOOR) ** -0.5, (rows, columns))
    distance = np.hypot(np.fft.fftfreq(rows, 1.0 / rows)[:, None], np.fft.fftfreq(columns, 1.0 / columns)[None, :])
    impulse *= _cosine_taper(distance, _FILTER_REACH_PX)
    return np.asarray(cv2.dft(impulse / impulse.sum()), dtype=np.float32)


def covariance_of_sums(
    images: NDArray[np.float32], kinds: tuple[tuple[NoiseCorrelation, NDArray[np.float64]], ...]
) -> NDArray[np.float64]:
    """Covariance of sums of noise weighed by images.

    Parameters
    ----------
    images
        Weights times the noise's standard deviation, shape (K, rows, columns).
    kinds
        NoiseCorrelation of each kind of noise, and its share in each pixel's variance, shape (rows, columns).

    Returns
    -------
    NDArray
        Shape (K, K).
    """
    rows, columns = (fft.next_fast_len(side + _LAGS, real=True) for side in images.shape[1:])
    # a half spectrum holds all but its first column (and, for even widths, its last) once instead of twice
    twice = np.full(columns // 2 + 1, 2.0)
    twice[0] = 1.0
    if columns % 2 == 0:
        twice[-1] = 1.0

    def of_kind(kind: tuple[NoiseCorrelation, NDArray[np.float64]]) -> NDArray[np.float64]:
        correlation, share = kind
        power = correlation.spectrum((rows, columns)) * twice / (rows * columns)
        spectra = fft.rfft2(images * np.sqrt(share).astype(np.float32), (rows, columns))
        flat = (spectra * np.sqrt(power).astype(np.float32)).reshape(len(images), -1)
        return np.asarray((flat @ flat.conj().T).real, dtype=np.float64)

    return np.asarray(sum(mapped(of_kind, kinds, 2)))


def variance_by_brightness(residual: NDArray[np.float64], modelled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Noise variance of each pixel, shape (N,): robust in classes of equal count, interpolated over brightness."""
    edges = np.quantile(modelled, np.linspace(0.0, 1.0, _BRIGHTNESS_CLASSES + 1))
    klass = np.clip(np.searchsorted(edges, modelled) - 1, 0, _BRIGHTNESS_CLASSES - 1)
    brightness, variance = [], []
    for k in range(_BRIGHTNESS_CLASSES):
        members = klass == k
        if np.count_nonzero(members) < 2 * _BRIGHTNESS_CLASSES:
            continue
        brightness.append(float(modelled[members].mean()))
        variance.append(float((MEDIAN_TO_DEVIATION * np.median(np.abs(residual[members]))) ** 2))
    least = 1e-3 * max(variance) + 1e-12
    return np.asarray(np.interp(modelled, brightness, np.maximum(variance, least)))


def robust_weight(residual: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse variance, lowered for residuals beyond three standard deviations (Huber)."""
    deviations = np.abs(residual) / np.sqrt(variance)
    return np.asarray(np.minimum(1.0, _OUTLIER_DEVIATIONS / np.maximum(deviations, 1e-9)) / variance)


def _isotropic(by_lag: NDArray[np.float64]) -> NDArray[np.float64]:
    lags = np.arange(-_LAGS, _LAGS + 1)
    distance = np.hypot(lags[:, None], lags[None, :])
    rings = np.arange(_LAGS + 1)
    means = np.array([by_lag[np.abs(distance - ring) <= 0.5].mean() for ring in rings])
    return np.asarray(np.interp(distance, rings, means, right=0.0))


def _taper(lags: int, reach: float) -> NDArray[np.float64]:
    along = np.arange(-lags, lags + 1)
    return _cosine_taper(np.hypot(along[:, None], along[None, :]), reach)


def _cosine_taper(distance: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    inside = np.minimum(distance / reach, 1.0)
    return np.asarray(np.cos(0.5 * np.pi * inside) ** 2)
