"""The paper's distortion correction: a bivariate polynomial from measured pixels to the plate next to the detector."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import Aperture
from shared.geometry.camera import DisplacementField

_ORDERS = (2, 3, 4, 5, 6)
_LEAST_LEFT_OVER = 2.0
_NODES = 32
_BEYOND = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Dewarping:
    """Polynomial that takes measured to ideal pixels.

    Attributes
    ----------
    order
        Of the polynomial.
    centre_px, half_size_px
        What the coordinates are scaled by.
    coefficients
        Shape (terms, 2).
    inverse_normal
        Inverse of the normal matrix, shape (terms, terms).
    left_out_rms_px
        Rms per axis of each ball against the fit without it.
    """

    order: int
    centre_px: NDArray[np.float64]
    half_size_px: float
    coefficients: NDArray[np.float64]
    inverse_normal: NDArray[np.float64]
    left_out_rms_px: float

    def ideal_px(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ideal pixels, shape (N, 2), of measured ones, shape (N, 2)."""
        return np.asarray(self._basis(measured_px) @ self.coefficients)

    def standard_deviation_px(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the balls' errors leave uncertain, per axis, shape (N,)."""
        basis = self._basis(measured_px)
        leverage = np.einsum("ni,ij,nj->n", basis, self.inverse_normal, basis)
        return np.asarray(self.left_out_rms_px * np.sqrt(leverage))

    def _basis(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        return _terms((measured_px - self.centre_px) / self.half_size_px, self.order)


def fit_dewarping(measured_px: NDArray[np.float64], ideal_px: NDArray[np.float64]) -> Dewarping:
    """Fit the polynomial of the order whose left-out residuals are smallest; the paper does not say which it takes.

    Parameters
    ----------
    measured_px, ideal_px
        The balls of one plate as seen, and where they would appear without distortion, shape (N, 2) each, N >= 12.
    """
    low, high = measured_px.min(axis=0), measured_px.max(axis=0)
    centre, half_size = 0.5 * (low + high), float(0.5 * (high - low).max())
    scaled = (measured_px - centre) / half_size
    fits = []
    for order in _ORDERS:
        basis = _terms(scaled, order)
        if len(basis) < _LEAST_LEFT_OVER * basis.shape[1]:
            break
        inverse = np.linalg.inv(basis.T @ basis)
        coefficients = inverse @ basis.T @ ideal_px
        leverage = np.einsum("ni,ij,nj->n", basis, inverse, basis)
        left_out = (ideal_px - basis @ coefficients) / (1.0 - leverage)[:, None]
        rms = float(np.sqrt(np.mean(left_out**2)))
        fits.append(
            Dewarping(order, centre, half_size, np.asarray(coefficients), np.asarray(inverse, dtype=np.float64), rms)
        )
    return min(fits, key=lambda fit: fit.left_out_rms_px)


def _terms(scaled: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    x, y = scaled.T
    return np.stack([x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)], axis=-1)


def on_grid(dewarping: Dewarping, width_px: int, height_px: int, aperture: Aperture | None) -> DisplacementField:
    """The polynomial as the displacement field that the rest of the project takes.

    Nodes far outside the aperture take the value of the nearest place just outside it, where a polynomial runs away.
    """
    spacing = max(width_px, height_px) / _NODES
    x, y = (np.arange(-1, int(np.ceil(side / spacing)) + 2) * spacing for side in (width_px, height_px))
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    if aperture is not None:
        offset = nodes - np.array(aperture.centre_px)
        distance = np.maximum(np.hypot(*offset.T), 1e-9)
        drawn_in = np.minimum(1.0, (aperture.radius_px + _BEYOND * spacing) / distance)
        nodes = np.array(aperture.centre_px) + offset * drawn_in[:, None]
    shape = (len(y), len(x))
    displacement = dewarping.ideal_px(nodes) - nodes
    deviation = dewarping.standard_deviation_px(nodes)
    return DisplacementField(
        np.array([x[0], y[0]]), float(spacing), displacement.reshape(*shape, 2), deviation.reshape(shape)
    )
