"""Least-squares fits of blurred discs, many small image patches at once.

A steel ball's shadow is a disc with soft edges on an uneven background, seen through an unknown monotone curve. All
groups of one batch hold the same number K of discs whose shadows may overlap; where two overlap the image is darker
than under one of them, but not by the sum of both, so that the depth of the overlap is a parameter of its own.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

Array = NDArray[np.float64]

_BACKGROUND_TERMS = 6
_SQRT2 = float(np.sqrt(2.0))
_ITERATIONS = 14
_ROBUST_PASSES = 2
_HUBER = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class DiscPriors:
    """What is known of the discs before the fit, as mean and standard deviation.

    Attributes
    ----------
    radius_px, radius_sd_px
        Shape (G, K) each.
    blur_px, blur_sd_px
        Gaussian blur of the edges; one for all groups.
    drift_sd_px
        How far centres may lie from where they start.
    """

    radius_px: Array
    radius_sd_px: Array
    blur_px: float
    blur_sd_px: float
    drift_sd_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Pixels around each group, padded to equal length with weight zero.

    Attributes
    ----------
    x_px, y_px, grey, weight
        Shape (G, P) each; weight is 0 or 1.
    """

    x_px: Array
    y_px: Array
    grey: Array
    weight: Array


@dataclass(frozen=True, slots=True, eq=False)
class DiscFits:
    """Fitted groups.

    Attributes
    ----------
    centre_px
        Shape (G, K, 2).
    centre_covariance_px2
        Shape (G, K, 2, 2); from the residuals of the patch itself.
    radius_px, contrast, contrast_sd
        Shape (G, K).
    blur_px, residual
        Blur and robust residual in grey values, shape (G,).
    """

    centre_px: Array
    centre_covariance_px2: Array
    radius_px: Array
    contrast: Array
    contrast_sd: Array
    blur_px: Array
    residual: Array


@dataclass(slots=True)
class _State:
    """Parameters during the iteration: background (G, 6), contrast, x, y, radius (G, K), overlap and blur (G,)."""

    background: Array
    contrast: Array
    x: Array
    y: Array
    radius: Array
    overlap: Array
    blur: Array

    def vector(self) -> Array:
        """All parameters, shape (G, 6 + 4 K + 2)."""
        tail = [self.overlap[:, None], self.blur[:, None]]
        return np.concatenate([self.background, self.contrast, self.x, self.y, self.radius, *tail], axis=1)

    @staticmethod
    def of(vector: Array, discs: int) -> "_State":
        """Inverse of `vector`."""
        b, k = _BACKGROUND_TERMS, discs
        parts = [vector[:, b + i * k : b + (i + 1) * k] for i in range(4)]
        return _State(vector[:, :b], *parts, vector[:, -2], vector[:, -1])


def fit_discs(patches: Patches, start_px: Array, priors: DiscPriors) -> DiscFits:
    """Fit K blurred discs on a curved background to each patch.

    Parameters
    ----------
    patches
        G patches.
    start_px
        Where the discs are thought to be, shape (G, K, 2).
    priors
        What is known of radius and blur.

    Returns
    -------
    DiscFits
        The covariance takes the residual of each patch for its noise; correlation of noise is left to the caller.
    """
    basis, scale = _background_basis(patches)
    grey, unit_grey = _normalised(patches)
    state = _start(patches, grey, start_px, priors)
    discs = start_px.shape[1]
    mean = state.vector()
    precision = _prior_precision(state, priors, scale)
    weight = patches.weight.copy()
    noise = np.ones(len(grey))
    for outer in range(_ROBUST_PASSES + 1):
        state, residual = _levenberg(patches, grey, basis, weight, state, mean, precision, noise)
        noise = _noise(residual, patches.weight)
        if outer < _ROBUST_PASSES:
            size = np.abs(residual) / noise[:, None]
            weight = patches.weight * np.minimum(1.0, _HUBER / np.maximum(size, 1e-9))
    _, jacobian = _model(patches, basis, state)
    covariance = _covariance(jacobian, weight, precision, noise)
    return _fits(state, covariance, unit_grey, noise, discs)


def _normalised(patches: Patches) -> tuple[Array, Array]:
    """Grey values with the patch's own mean and spread taken out, and that spread, shape (G,)."""
    count = patches.weight.sum(axis=1)
    mean = (patches.grey * patches.weight).sum(axis=1) / count
    centred = (patches.grey - mean[:, None]) * patches.weight
    spread = np.sqrt((centred**2).sum(axis=1) / count)
    spread = np.where(spread > 0.0, spread, 1.0)
    return centred / spread[:, None], spread


def _background_basis(patches: Patches) -> tuple[Array, float]:
    """Constant, slopes and curvatures over each patch, shape (G, P, 6), and the scale of length in pixels."""
    count = patches.weight.sum(axis=1)
    centre_x = (patches.x_px * patches.weight).sum(axis=1) / count
    centre_y = (patches.y_px * patches.weight).sum(axis=1) / count
    dx, dy = patches.x_px - centre_x[:, None], patches.y_px - centre_y[:, None]
    scale = float(np.sqrt((dx**2 + dy**2) * patches.weight).max())
    u, v = dx / scale, dy / scale
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1), scale


def _start(patches: Patches, grey: Array, start_px: Array, priors: DiscPriors) -> _State:
    groups, discs = start_px.shape[:2]
    background = np.zeros((groups, _BACKGROUND_TERMS))
    background[:, 0] = np.quantile(np.where(patches.weight > 0, grey, 0.0), 0.7, axis=1)
    return _State(
        background=background,
        contrast=np.full((groups, discs), 1.5),
        x=start_px[..., 0].copy(),
        y=start_px[..., 1].copy(),
        radius=priors.radius_px.copy(),
        overlap=np.full(groups, 0.8),
        blur=np.full(groups, priors.blur_px),
    )


def _prior_precision(state: _State, priors: DiscPriors, scale: float) -> Array:
    """Inverse variances of the priors, in the order of `_State.vector`, shape (G, M)."""
    del scale
    weak = 1e-4
    precision = _State(
        background=np.full_like(state.background, weak),
        contrast=np.full_like(state.contrast, weak),
        x=np.full_like(state.x, priors.drift_sd_px**-2),
        y=np.full_like(state.y, priors.drift_sd_px**-2),
        radius=priors.radius_sd_px**-2.0,
        overlap=np.full_like(state.overlap, 0.3**-2),
        blur=np.full_like(state.blur, priors.blur_sd_px**-2),
    )
    precision.background[:, 3:] = 1.0
    return precision.vector()


def _model(patches: Patches, basis: Array, state: _State) -> tuple[Array, Array]:
    """Grey values of the model, shape (G, P), and their derivatives, shape (G, P, M)."""
    dx = patches.x_px[:, :, None] - state.x[:, None, :]
    dy = patches.y_px[:, :, None] - state.y[:, None, :]
    distance = np.sqrt(dx**2 + dy**2) + 1e-9
    z = (distance - state.radius[:, None, :]) / state.blur[:, None, None]
    disc = 0.5 * erfc(z / _SQRT2)
    edge = np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * state.blur[:, None, None])
    shadow, d_disc, d_contrast, overlap = _shadow(disc, state)
    grey = np.einsum("gpb,gb->gp", basis, state.background) - shadow
    along = -d_disc * edge
    jacobian = [
        basis,
        -d_contrast,
        along * dx / distance,
        along * dy / distance,
        along,
        overlap[:, :, None],
        (along * z).sum(axis=2, keepdims=True),
    ]
    return grey, np.concatenate(jacobian, axis=2)


def _shadow(disc: Array, state: _State) -> tuple[Array, Array, Array, Array]:
    """Depth of all discs together, its derivatives by disc and by contrast, and the common part of overlaps."""
    contrast = state.contrast[:, None, :]
    total = (contrast * disc).sum(axis=2)
    d_disc = np.broadcast_to(contrast, disc.shape).copy()
    d_contrast = disc.copy()
    common = np.zeros_like(total)
    overlap = state.overlap[:, None]
    for i, j in combinations(range(disc.shape[2]), 2):
        depth = 0.5 * (state.contrast[:, i] + state.contrast[:, j])[:, None]
        both = disc[:, :, i] * disc[:, :, j]
        common += depth * both
        d_disc[:, :, i] -= overlap * depth * disc[:, :, j]
        d_disc[:, :, j] -= overlap * depth * disc[:, :, i]
        d_contrast[:, :, i] -= 0.5 * overlap * both
        d_contrast[:, :, j] -= 0.5 * overlap * both
    return total - overlap * common, d_disc, d_contrast, common


def _levenberg(
    patches: Patches,
    grey: Array,
    basis: Array,
    weight: Array,
    state: _State,
    mean: Array,
    precision: Array,
    noise: Array,
) -> tuple[_State, Array]:
    """Damped Gauss-Newton on all groups side by side; returns the state and its residuals, shape (G, P)."""
    discs = state.x.shape[1]
    damping = np.full(len(grey), 1e-2)
    variance = (0.05 * noise if np.all(noise == 1.0) else noise)[:, None] ** 2
    vector = state.vector()
    modelled, jacobian = _model(patches, basis, state)
    cost = _cost(grey - modelled, weight, vector, mean, precision, variance)
    for _ in range(_ITERATIONS):
        normal, gradient = _normal_equations(
            grey - modelled, jacobian, weight / variance, vector - mean, precision
        )
        diagonal = np.einsum("gii->gi", normal)
        damped = normal.copy()
        np.einsum("gii->gi", damped)[...] += damping[:, None] * diagonal
        trial = _bounded(vector + np.linalg.solve(damped, gradient[:, :, None])[:, :, 0], mean, discs)
        trial_modelled, trial_jacobian = _model(patches, basis, _State.of(trial, discs))
        trial_cost = _cost(grey - trial_modelled, weight, trial, mean, precision, variance)
        better = trial_cost < cost
        gain = float(np.max(np.where(better, (cost - trial_cost) / (cost + 1e-9), 0.0)))
        vector = np.where(better[:, None], trial, vector)
        modelled = np.where(better[:, None], trial_modelled, modelled)
        jacobian = np.where(better[:, None, None], trial_jacobian, jacobian)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping * 0.2, damping * 8.0)
        if gain < 1e-5 and bool(np.all(better | (damping > 1e2))):
            break
    return _State.of(vector, discs), grey - modelled


def _bounded(vector: Array, mean: Array, discs: int) -> Array:
    """Keep radius and blur positive, and the overlap between sum and union of shadows."""
    state = _State.of(vector.copy(), discs)
    start = _State.of(mean, discs)
    state.radius = np.clip(state.radius, 0.5 * start.radius, 1.6 * start.radius)
    state.blur = np.clip(state.blur, 0.4, 4.0)
    state.overlap = np.clip(state.overlap, 0.0, 1.2)
    return state.vector()


def _cost(residual: Array, weight: Array, vector: Array, mean: Array, precision: Array, variance: Array) -> Array:
    return np.asarray(
        (weight * residual**2 / variance).sum(axis=1) + (precision * (vector - mean) ** 2).sum(axis=1)
    )


def _normal_equations(
    residual: Array, jacobian: Array, weight: Array, from_mean: Array, precision: Array
) -> tuple[Array, Array]:
    weighted = jacobian * weight[:, :, None]
    normal = np.matmul(weighted.transpose(0, 2, 1), jacobian)
    np.einsum("gii->gi", normal)[...] += precision
    gradient = np.einsum("gpm,gp->gm", weighted, residual) - precision * from_mean
    return normal, gradient


def _noise(residual: Array, weight: Array) -> Array:
    """Robust standard deviation of the residuals of each patch, shape (G,)."""
    magnitude = np.where(weight > 0, np.abs(residual), np.nan)
    return np.maximum(1.4826 * np.nanmedian(magnitude, axis=1), 1e-4)


def _covariance(jacobian: Array, weight: Array, precision: Array, noise: Array) -> Array:
    normal = np.matmul((jacobian * (weight / noise[:, None] ** 2)[:, :, None]).transpose(0, 2, 1), jacobian)
    np.einsum("gii->gi", normal)[...] += precision
    return np.linalg.inv(normal)


def _fits(state: _State, covariance: Array, unit_grey: Array, noise: Array, discs: int) -> DiscFits:
    b = _BACKGROUND_TERMS
    contrast_at = b + np.arange(discs)
    x_at, y_at = contrast_at + discs, contrast_at + 2 * discs
    centre_covariance = np.empty((len(unit_grey), discs, 2, 2))
    for i, rows in enumerate((x_at, y_at)):
        for j, columns in enumerate((x_at, y_at)):
            centre_covariance[:, :, i, j] = covariance[:, rows, columns]
    contrast_sd = np.sqrt(np.einsum("gkk->gk", covariance[:, contrast_at][:, :, contrast_at]))
    return DiscFits(
        centre_px=np.stack([state.x, state.y], axis=-1),
        centre_covariance_px2=centre_covariance,
        radius_px=state.radius,
        contrast=state.contrast * unit_grey[:, None],
        contrast_sd=contrast_sd * unit_grey[:, None],
        blur_px=state.blur,
        residual=noise * unit_grey,
    )
