"""The noise model, estimated from residuals: variance by brightness, correlation, and a whitening filter.

The detector blurs X-ray noise together with the image, so that neighbouring pixels are correlated: a fit that assumes
independent pixels weights blurred and sharp detail wrongly and underestimates its errors three times.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from services.registration.core.nail.imaging_chain import Real, blurred_image
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import NAIL_NOISE
from shared.two_cores import mapped
from shared.xray.tuning import DEVIATION_PER_MEDIAN


@dataclass(frozen=True, slots=True, eq=False)
class NoiseCorrelation:
    """Correlation of standardised residuals by lag, shape (2 L + 1, 2 L + 1), 1 in the middle."""

    by_lag: NDArray[np.float64]

    @property
    def inflation(self) -> float:
        """By how much the variance of a mean over many pixels exceeds that of independent ones (at least 1)."""
        return max(1.0, float((self.by_lag * _taper()).sum()))

    def spectrum(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Power by frequency, never negative, the same in all directions: half spectrum of a rectangle of a shape."""
        kernel = np.zeros(shape)
        kernel[np.ix_(_lags(), _lags())] = _isotropic(self.by_lag) * _taper()
        return np.maximum(fft.rfft2(kernel).real, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class WhiteningFilter:
    """Short symmetric filters, gain one for slow variations, that make the noise about independent between pixels.

    Where metal stops the quanta the electronics' noise remains, which no blur has correlated: dark and bright places
    need a filter each.
    """

    # Spectra of the two filters on the padded rectangle, packed as OpenCV packs those of real images
    dark: NDArray[np.float32]
    bright: NDArray[np.float32]
    brightness: NDArray[np.float32]  # weight of the bright one in each pixel's filter, shape (rows, columns)

    def after(self, earlier: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> "WhiteningFilter":
        """A symmetric filter and then this one as one filter, exact but for a rim of the image.

        There, beyond the padding, this one's spectrum wraps round, while the filters one by one repeat edge values.

        Parameters
        ----------
        earlier
            That filter, of an image of any size; far shorter than the image.
        """
        rows, columns = self.dark.shape
        impulse = np.zeros((rows, columns), dtype=np.float32)
        impulse[rows // 2, columns // 2] = 1.0
        before = cv2.dft(np.roll(earlier(impulse), (-(rows // 2), -(columns // 2)), axis=(0, 1)))
        dark, bright = (cv2.mulSpectrums(own, before, 0) for own in (self.dark, self.bright))
        return WhiteningFilter(
            np.asarray(dark, dtype=np.float32), np.asarray(bright, dtype=np.float32), self.brightness
        )

    def apply(self, image: NDArray[Real]) -> NDArray[np.float32]:
        """Filter an image, shape (rows, columns), edge values repeated beyond its border."""
        image = image.astype(np.float32, copy=False)
        rows, columns = image.shape
        pad = _padding_px()
        here = slice(pad, pad + rows), slice(pad, pad + columns)
        below, beside = self.dark.shape[0] - rows - pad, self.dark.shape[1] - columns - pad
        spectrum = cv2.dft(cv2.copyMakeBorder(image, pad, below, pad, beside, cv2.BORDER_REPLICATE))
        dark, bright = (
            cv2.idft(cv2.mulSpectrums(spectrum, response, 0), flags=cv2.DFT_SCALE)[here]
            for response in (self.dark, self.bright)
        )
        return np.asarray(dark + self.brightness * (bright - dark))


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModel:
    """Noise of a fit: variance and correlation of its residuals."""

    variance: NDArray[np.float64]  # per compared pixel, shape (N,)
    brightness: NDArray[np.float64]  # from metal (0) to background (1) on the whole rectangle, shape (rows, columns)
    # Correlation of the standardised residuals between pixels of either kind
    dark: NoiseCorrelation
    bright: NoiseCorrelation
    # Variance of a mean over many pixels over that of independent ones, by brightness, shape (N,)
    inflation: NDArray[np.float64]


def noise_model(
    region: FitRegion,
    transmission: NDArray[np.float64],
    modelled: NDArray[np.float64],
    residual: NDArray[np.float64],
) -> NoiseModel:
    """Estimate the noise from residuals, shape (N,), of modelled grey values, shape (N,).

    Parameters
    ----------
    transmission
        Of the whole rectangle, which separates metal from background, shape (rows, columns).
    """
    variance = variance_by_brightness(residual, modelled)
    most = NAIL_NOISE.clipped_deviations
    standardised = np.clip(residual / np.sqrt(variance), -most, most)
    brightness = np.clip(blurred_image(transmission, NAIL_NOISE.brightness_blur_px), 0.0, 1.0)
    here = brightness.ravel()[region.compared]

    def of_kind(kind: NDArray[np.bool_]) -> NoiseCorrelation:
        enough = kind if np.count_nonzero(kind) >= NAIL_NOISE.least_of_a_kind else np.ones_like(kind)
        return noise_correlation(standardised[enough], region.compared[enough], region.shape)

    dark, bright = mapped(of_kind, (here < 0.5, here >= 0.5), 2)
    inflation = (1.0 - here) * dark.inflation + here * bright.inflation
    return NoiseModel(variance, brightness, dark, bright, inflation)


def noise_correlation(
    standardised: NDArray[np.float64], places: NDArray[np.int64], shape: tuple[int, int]
) -> NoiseCorrelation:
    """Correlation of residuals, shape (N,), at flat indices, shape (N,), of a rectangle."""
    # single precision is plenty: sums of tens of thousands of squares, to a part in a million
    values, present = np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32)
    values.ravel()[places], present.ravel()[places] = standardised, 1.0
    padded = tuple(fft.next_fast_len(side + 2 * NAIL_NOISE.largest_lag_px, real=True) for side in shape)
    sums = fft.irfft2(np.abs(fft.rfft2(values, padded)) ** 2, padded)
    counts = fft.irfft2(np.abs(fft.rfft2(present, padded)) ** 2, padded)
    near = np.ix_(_lags(), _lags())
    by_lag = sums[near].astype(np.float64) / np.maximum(counts[near], 1.0)
    middle = NAIL_NOISE.largest_lag_px
    return NoiseCorrelation(by_lag / by_lag[middle, middle])


def whitening_filter(
    dark: NoiseCorrelation, bright: NoiseCorrelation, brightness: NDArray[np.float64]
) -> WhiteningFilter:
    """Filters whose responses are the inverse roots of the noise's power spectra, the same in all directions."""
    rows, columns = (cv2.getOptimalDFTSize(side + 2 * _padding_px()) for side in brightness.shape)
    of_dark, of_bright = mapped(lambda kind: _response(kind, (rows, columns)), (dark, bright), 2)
    return WhiteningFilter(of_dark, of_bright, brightness.astype(np.float32))


def _response(correlation: NoiseCorrelation, padded_shape: tuple[int, int]) -> NDArray[np.float32]:
    rows, columns = padded_shape
    power = correlation.spectrum(padded_shape)
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :])
    slow = frequency < NAIL_NOISE.lowest_frequency
    # residuals without slow parts, as after a filter, must not leave nothing to divide by
    level = max(float(power[slow].mean()), NAIL_NOISE.power_floor * float(power.mean()))
    # slow residuals are texture as much as noise: the filter must not act on them
    power[slow] = level
    impulse = fft.irfft2((power / level + NAIL_NOISE.power_floor) ** -0.5, (rows, columns))
    distance = np.hypot(np.fft.fftfreq(rows, 1.0 / rows)[:, None], np.fft.fftfreq(columns, 1.0 / columns)[None, :])
    impulse *= _cosine_taper(distance, NAIL_NOISE.filter_reach_px)
    return np.asarray(cv2.dft(impulse / impulse.sum()), dtype=np.float32)


def covariance_of_sums(
    images: NDArray[np.float32], kinds: tuple[tuple[NoiseCorrelation, NDArray[np.float64]], ...]
) -> NDArray[np.float64]:
    """Covariance of sums of noise weighted by images.

    Parameters
    ----------
    images
        Weights times the noise's standard deviation, shape (K, rows, columns).
    kinds
        Correlation of each kind of noise, and its share in each pixel's variance, shape (rows, columns).

    Returns
    -------
    NDArray
        Shape (K, K).
    """
    rows, columns = (fft.next_fast_len(side + NAIL_NOISE.largest_lag_px, real=True) for side in images.shape[1:])
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
    """Noise variance of each pixel, shape (N,): robust in classes of equal count, interpolated over brightness.

    Pixels too few for classes, as around holes that wires cover, are one class.
    """
    classes = NAIL_NOISE.brightness_classes
    edges = np.quantile(modelled, np.linspace(0.0, 1.0, classes + 1))
    klass = np.clip(np.searchsorted(edges, modelled) - 1, 0, classes - 1)
    brightness, variance = [], []
    for k in range(classes):
        members = klass == k
        if np.count_nonzero(members) < NAIL_NOISE.least_of_a_class:
            continue
        brightness.append(float(modelled[members].mean()))
        variance.append(_robust_variance(residual[members]))
    if not variance:
        brightness, variance = [float(modelled.mean())], [_robust_variance(residual)]
    least = NAIL_NOISE.least_variance_share * max(variance) + 1e-12
    return np.asarray(np.interp(modelled, brightness, np.maximum(variance, least)))


def _robust_variance(residual: NDArray[np.float64]) -> float:
    return float((DEVIATION_PER_MEDIAN * np.median(np.abs(residual))) ** 2)


def huber_precision(residual: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse variance, lowered for residuals beyond three standard deviations (Huber)."""
    deviations = np.abs(residual) / np.sqrt(variance)
    return np.asarray(np.minimum(1.0, NAIL_NOISE.outlier_deviations / np.maximum(deviations, 1e-9)) / variance)


def _isotropic(by_lag: NDArray[np.float64]) -> NDArray[np.float64]:
    distance = np.hypot(_lags()[:, None], _lags()[None, :])
    rings = np.arange(NAIL_NOISE.largest_lag_px + 1)
    means = np.array([by_lag[np.abs(distance - ring) <= 0.5].mean() for ring in rings])
    return np.asarray(np.interp(distance, rings, means, right=0.0))


def _lags() -> NDArray[np.int64]:
    return np.arange(-NAIL_NOISE.largest_lag_px, NAIL_NOISE.largest_lag_px + 1)


def _padding_px() -> int:
    """Margin beyond the image into which the filter reaches."""
    return int(np.ceil(NAIL_NOISE.filter_reach_px))


def _taper() -> NDArray[np.float64]:
    return _cosine_taper(np.hypot(_lags()[:, None], _lags()[None, :]), NAIL_NOISE.taper_px)


def _cosine_taper(distance: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    inside = np.minimum(distance / reach, 1.0)
    return np.asarray(np.cos(0.5 * np.pi * inside) ** 2)
