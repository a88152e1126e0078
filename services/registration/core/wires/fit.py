"""Robust least-squares fit of one K-wire's axis, in the guide's frame, to its outlines in one image or more.

Besides the wire's own unknowns (`WireModel`), every image has an error of the wire's apparent radius and one of the
guide's pose, each with its prior. What the images do not determine keeps the variance of its prior: one oblique image
leaves the axis free within a plane, and the covariance shows it. The nail's pose is an unknown too: its errors and the
guide's are correlated (`JointRegistration`), so that a wire that corrects the guide corrects the nail.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import WIRE_DARKNESS, WIRE_SEEN, WIRE_SHARE
from services.registration.core.estimation.robust import robust_weight
from services.registration.core.tuning import WIRE_FITTING, WIRE_PRIOR
from services.registration.core.wires.image import GradientImage
from services.registration.core.wires.model import START, TIP, WIRE_UNKNOWNS, WireModel, wire_models
from services.registration.core.wires.outline import (
    IMAGE_UNKNOWNS,
    EdgeMatches,
    ProjectedWire,
    cross_sections,
    match_edges,
    project_wire,
    starting_wires,
)
from shared.errors import Reason
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import read_only
from shared.geometry.parts import GuidePart, Hole, NailPart
from shared.geometry.transform import Transform

# A rigid motion's degrees of freedom.
NAIL_UNKNOWNS = 6
_NAIL = np.arange(-NAIL_UNKNOWNS, 0)
# What a fit reports: the wire's four offsets, and the nail.
_REPORTED = np.concatenate([np.arange(4), _NAIL])
# Steps of the numerical derivatives: px and mm, and rad for the guide's rotation.
_STEPS = np.array([1e-3] * (WIRE_UNKNOWNS + 1) + [1e-5] * 3 + [1e-3] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Linearised observations of one image: edges near the wire's outline."""

    image: GradientImage
    wire: ProjectedWire
    matches: EdgeMatches
    # Of the outline's points along their normals by the unknowns of wire and image, shape (N, 13)
    derivative: NDArray[np.float64]
    weight: NDArray[np.float64]  # inverse variances, shape (N,)
    effective_count: float  # number of independent observations

    @property
    def visible_px(self) -> float:
        """Visible length of outline."""
        return float(self.wire.visible_px.sum())

    @property
    def found_px(self) -> float:
        """Length of outline that lies on an edge."""
        within_px = self.image.length_px(WIRE_FITTING.found_within_detector_mm)
        found = self.matches.weight * (np.abs(self.matches.residual_px) < within_px)
        return float(found @ self.wire.visible_px[self.matches.index])

    @property
    def log_likelihood(self) -> float:
        """Long-tailed log-likelihood of each correlation length of outline, with a constant where there is no edge."""
        scale_px = self.image.length_px(WIRE_FITTING.found_scale_detector_mm)
        found = WIRE_FITTING.found_gain - np.log1p((self.matches.residual_px / scale_px) ** 2)
        gain = np.full(len(self.wire.visible_px), WIRE_FITTING.missing_gain)
        gain[self.matches.index] += self.matches.weight * (found - WIRE_FITTING.missing_gain)
        return float(gain @ self.wire.visible_px) / self.image.length_px(WIRE_FITTING.edge_correlation_detector_mm)


@dataclass(frozen=True, slots=True, eq=False)
class WireProblem:
    """What a wire is fitted to: images, and the prior of all unknowns.

    The unknowns are those of the wire, then radius and guide of each image, then the nail: N in all.
    """

    images: tuple[GradientImage, ...]
    model: WireModel
    prior: NDArray[np.float64]  # precision, shape (N, N)

    @staticmethod
    def of(images: tuple[GradientImage, ...], model: WireModel, prior_covariance: NDArray[np.float64]) -> "WireProblem":
        """The prior covariance is that of guide and nail, as `JointRegistration.covariance`."""
        size = WIRE_UNKNOWNS + IMAGE_UNKNOWNS * len(images) + NAIL_UNKNOWNS
        prior = np.zeros((size, size))
        prior[:WIRE_UNKNOWNS, :WIRE_UNKNOWNS] = model.precision
        radius = WIRE_UNKNOWNS + IMAGE_UNKNOWNS * np.arange(len(images))
        prior[radius, radius] = [image.length_px(WIRE_FITTING.radius_sd_detector_mm) ** -2 for image in images]
        others = np.setdiff1d(np.arange(WIRE_UNKNOWNS, size), radius)
        prior[np.ix_(others, others)] = np.linalg.inv(prior_covariance)
        return WireProblem(images, model, prior)

    def at(self, state: NDArray[np.float64], reach_detector_mm: float) -> "LinearisedFit":
        """Linearise all images and the prior at a state, shape (N,)."""
        mean = np.concatenate([self.model.mean, np.zeros(state.size - WIRE_UNKNOWNS)])
        normal, gradient = self.prior.copy(), self.prior @ (mean - state)
        all_residuals = []
        for k, image in enumerate(self.images):
            of_image = WIRE_UNKNOWNS + k * IMAGE_UNKNOWNS + np.arange(IMAGE_UNKNOWNS)
            columns = np.concatenate([np.arange(WIRE_UNKNOWNS), of_image])
            residuals = _residuals(image, self.model, state[columns], image.length_px(reach_detector_mm))
            weighted = residuals.weight[:, None] * residuals.derivative
            normal[np.ix_(columns, columns)] += weighted.T @ residuals.derivative
            gradient[columns] += weighted.T @ residuals.matches.residual_px
            all_residuals.append(residuals)
        squares = sum(float(one.weight @ one.matches.residual_px**2) for one in all_residuals)
        count = sum(one.effective_count for one in all_residuals)
        return LinearisedFit(self, state, normal, gradient, squares / max(count, 1.0), tuple(all_residuals))

    def converged(self, start: NDArray[np.float64]) -> "LinearisedFit":
        """Gauss-Newton steps from a wire, shape (6,)."""
        state = np.concatenate([start, np.zeros(len(self.prior) - WIRE_UNKNOWNS)])
        for reach_mm in WIRE_FITTING.reaches_detector_mm:
            here = self.at(state, reach_mm)
            state = state + np.linalg.solve(here.normal, here.gradient)
        return self.at(state, reach_mm)


def _residuals(image: GradientImage, model: WireModel, unknowns: NDArray[np.float64], reach_px: float) -> Residuals:
    wire = project_wire(image, model, unknowns)
    matches = match_edges(image, wire, reach_px)
    section, outward = wire.outline.section[matches.index], wire.outline.outward[matches.index]
    moved = cross_sections(image, model, unknowns + np.diag(_STEPS), len(wire.sections.radius_px))
    by_centre = (moved.centre_px - wire.sections.centre_px)[:, section]
    derivative = np.einsum("jmi,mi->mj", by_centre, outward) / _STEPS
    # A change of apparent radius along the wire is left to the image's own radius error: edges shift with contrast.
    ends = [START, TIP, WIRE_UNKNOWNS]
    by_radius = (moved.radius_px[ends] - wire.sections.radius_px) / _STEPS[ends, None]
    derivative[:, ends] += by_radius[:, section].T
    correlation_px = image.length_px(WIRE_FITTING.edge_correlation_detector_mm)
    crowding = np.maximum(correlation_px / np.maximum(wire.outline.length_px[matches.index], 1e-6), 1.0)
    effective = matches.weight / crowding
    sd_px, robust_px = (
        image.length_px(mm) for mm in (WIRE_FITTING.edge_sd_detector_mm, WIRE_FITTING.robust_detector_mm)
    )
    weight = effective * robust_weight(matches.residual_px, robust_px) / sd_px**2
    return Residuals(image, wire, matches, derivative, weight, float(effective.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class WireFit:
    """Estimate of a wire's axis."""

    model: WireModel
    # Offsets across the guide hole's axis at the guide and at the nail (see `WireModel`), shape (4,)
    offsets_mm: NDArray[np.float64]
    # Start and tip of the wire along the guide hole's axis, and their standard deviations, shape (2,)
    ends_mm: NDArray[np.float64]
    ends_sd_mm: NDArray[np.float64]
    # correction of the nail's pose by the wire: a small motion of the nail in its own frame, shape (6,)
    nail_motion: NDArray[np.float64]
    covariance: NDArray[np.float64]  # of the offsets (mm) and the motion (rad, mm) together, shape (10, 10)
    found_px: float  # length of outline that lies on an edge, in all images
    found_fraction: float  # of the visible outline, in the image where it is least
    # Of the wire between the nail's metal (1) and what lies beside the wire (0), weighted median over all images
    darkness: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedFit:
    """A state with the normal equations of the prior and all observations there."""

    problem: WireProblem
    state: NDArray[np.float64]  # shape (N,)
    normal: NDArray[np.float64]  # shape (N, N)
    gradient: NDArray[np.float64]  # shape (N,)
    mean_square: float  # of the observations, one on average
    residuals: tuple[Residuals, ...]  # of each image

    @property
    def found_fraction(self) -> float:
        """Least fraction of the visible outline on an edge in any image where enough is visible; 0 if none."""
        shares = [one.found_px / one.visible_px for one in self.residuals if WIRE_SEEN.is_met(one.visible_px)]
        return min(shares, default=0.0)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of offsets and nail; observations that fit worse than expected have larger variances."""
        prior = self.problem.prior
        observed = (self.normal - prior) / max(1.0, self.mean_square)
        inverse = np.linalg.inv(prior + observed)
        return np.asarray(inverse[np.ix_(_REPORTED, _REPORTED)], dtype=np.float64)

    @property
    def log_likelihood(self) -> float:
        """Of prior and images, up to a constant."""
        model = self.problem.model
        deviation = self.state[:WIRE_UNKNOWNS] - model.mean
        prior = -0.5 * float(deviation @ model.precision @ deviation) - float(np.log(model.tip_sd_mm))
        return prior + sum(one.log_likelihood for one in self.residuals) - self._interference_cost

    @property
    def _interference_cost(self) -> float:
        """Negative log-likelihood of a wire that passed the nail although it interferes with it."""
        passage = self.problem.model.passage
        if passage is None:
            return 0.0
        bent_mm = max(passage.interference_mm(self.state[2:4]) - WIRE_PRIOR.bending_mm, 0.0)
        variance_mm2 = float(np.linalg.eigvalsh(self.covariance[2:4, 2:4])[-1])
        return 0.5 * bent_mm**2 / variance_mm2


def detect_wire(
    images: tuple[GradientImage, ...],
    guide: GuidePart,
    guide_hole: Hole,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    prior_covariance: NDArray[np.float64],
    wire_diameter_mm: float,
) -> WireFit | Reason:
    """Fit the wire through one guide hole, of which the nail has one of the same id, or report why none was detected.

    The prior covariance is that of guide and nail, as `JointRegistration.covariance`.
    """
    models = wire_models(guide, guide_hole, nail, guide_from_nail, wire_diameter_mm)
    fit = fit_wire(images, models, prior_covariance)
    if WIRE_SEEN.is_met(fit.found_px) and WIRE_SHARE.is_met(fit.found_fraction) and WIRE_DARKNESS.is_met(fit.darkness):
        return fit
    return WIRE_SEEN.reason(
        f"no wire was found through guide hole '{guide_hole.id}': {WIRE_SEEN.quoted(fit.found_px)} of its outline are "
        f"visible, {WIRE_SHARE.quoted(fit.found_fraction)} of what is not hidden, and it is "
        f"{WIRE_DARKNESS.quoted(max(fit.darkness, 0.0))} as dark as the nail"
    )


def fit_wire(
    images: tuple[GradientImage, ...], models: tuple[WireModel, ...], prior_covariance: NDArray[np.float64]
) -> WireFit:
    """Fit a wire near its guide hole's axis in all images together.

    Starts on a grid of axes are ranked by how much outline lies on edges; from the best ones Gauss-Newton steps with
    Cauchy weights converge to local optima, and the most likely optimum is reported. Others that explain the images
    nearly as well (seen nearly end on, a wire appears the same from its other end; it may have passed the nail) widen
    the covariance by their distance, in proportion to their likelihood.

    An image in which the wire would be visible must show it: optima that one image contradicts do not count if there is
    another.

    The models are of the same wire, with equal prior probability; in at least one it may be anywhere. The prior
    covariance is that of guide and nail, as `JointRegistration.covariance`, shape (6 V + 6, 6 V + 6).
    """
    problems = [WireProblem.of(images, model, prior_covariance) for model in models]
    converged = [one.converged(start) for one in problems for start in starting_wires(images, one.model)]
    possible = [one for one in converged if one.state[START] <= one.problem.model.latest_start_mm] or converged
    optima = (
        _uncontradicted(possible)
        or _uncontradicted(_along_least_certain(max(possible, key=lambda one: one.log_likelihood)))
        or possible
    )
    best = max(optima, key=lambda one: one.log_likelihood)
    residuals, model = best.residuals, best.problem.model
    return WireFit(
        model=model,
        offsets_mm=read_only(best.state[:4]),
        ends_mm=read_only(best.state[[START, TIP]]),
        ends_sd_mm=read_only(np.sqrt(np.diag(np.linalg.inv(best.normal))[[START, TIP]])),
        nail_motion=read_only(best.state[_NAIL]),
        covariance=read_only(_mixture_covariance(optima, best)),
        found_px=sum(one.found_px for one in residuals),
        found_fraction=best.found_fraction,
        darkness=_median_darkness(residuals),
    )


def _mixture_covariance(optima: list[LinearisedFit], best: LinearisedFit) -> NDArray[np.float64]:
    """Second moment about the best optimum of all distinct ones, weighted by their tempered likelihoods, (10, 10)."""
    covariance, total = np.zeros((len(_REPORTED), len(_REPORTED))), 0.0
    for optimum in _distinct(optima, best):
        weight = float(np.exp(WIRE_FITTING.optimum_temper * (optimum.log_likelihood - best.log_likelihood)))
        apart = (optimum.state - best.state)[_REPORTED]
        covariance += weight * (optimum.covariance + np.outer(apart, apart))
        total += weight
    return covariance / total


def _median_darkness(residuals: tuple[Residuals, ...]) -> float:
    """Weighted median over the outlines' points; 0 when there is none."""
    darkness = np.concatenate([one.matches.darkness for one in residuals])
    weight = np.concatenate([one.matches.weight for one in residuals])
    return float(np.quantile(darkness, 0.5, weights=weight, method="inverted_cdf")) if len(darkness) else 0.0


def _uncontradicted(optima: list[LinearisedFit]) -> list[LinearisedFit]:
    return [optimum for optimum in optima if WIRE_SHARE.is_met(optimum.found_fraction)]


def _along_least_certain(best: LinearisedFit) -> list[LinearisedFit]:
    """The best optimum moved along its least certain direction, to where an image may hide the wire."""
    covariance = np.linalg.inv(best.normal)
    values, vectors = np.linalg.eigh(covariance[:4, :4])
    one_sigma = covariance[:, :4] @ vectors[:, -1] / np.sqrt(values[-1])
    sigmas = np.linspace(-WIRE_FITTING.scan_sigmas, WIRE_FITTING.scan_sigmas, WIRE_FITTING.scan_steps)
    reach_mm = WIRE_FITTING.reaches_detector_mm[-1]
    return [best.problem.at(best.state + sigma * one_sigma, reach_mm) for sigma in sigmas]


def _distinct(optima: list[LinearisedFit], best: LinearisedFit) -> list[LinearisedFit]:
    """The best optimum and those that differ from it and from one another by more than convergence leaves open."""
    chosen = [best]
    for optimum in sorted(optima, key=lambda one: -one.log_likelihood):
        apart_mm = min(float(np.abs((optimum.state - other.state)[:4]).max()) for other in chosen)
        if apart_mm > WIRE_FITTING.same_optimum_mm:
            chosen.append(optimum)
    return chosen
