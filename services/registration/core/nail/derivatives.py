"""Derivatives of the forward model: of the visible fraction by the fit's parameters, and by the holes' own turns."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import DERIVATIVES, MOTION_SIZE
from services.registration.core.nail.forward_model import (
    ForwardModel,
    TracedTransmission,
    guide_transmission,
    nail_shape,
)
from services.registration.core.nail.imaging_chain import (
    CHAIN_PARAMETERS,
    SHARPENING_PARAMETERS,
    ChainImages,
    ImagingChain,
    chain_derivative,
    imaging_chain,
)
from services.registration.core.nail.parameters import CURVATURE, Parameter, chamfer, curvature_of
from services.registration.core.nail.rays import section_places
from shared.geometry.bend import section_frame, section_motions
from shared.geometry.lines import unit
from shared.geometry.parts import Hole, across_holes, hole_axis
from shared.two_cores import mapped

# Parameters in the order of the kernel's derivatives.
_PATH_PARAMETERS = tuple(Parameter)[: Parameter.HARDENING + 1]
# Images with fewer pixels in all are done sooner than handed to another core.
_LEAST_PIXELS_TO_SHARE = 100_000


def visible_fraction_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by the free parameters, in their order."""
    through = _ThroughChain.at(model, traced)
    transmission, images = through.transmission, through.images
    least = 2 + _LEAST_PIXELS_TO_SHARE // transmission.size

    def by_chain(parameter: Parameter) -> NDArray[np.float64]:
        change = chain_derivative(parameter, model.region.sampling, traced.parameters, transmission, images)
        return model.compared_values(change) if parameter in SHARPENING_PARAMETERS else through.sharpened_values(change)

    by_path = _transmission_derivatives(model, traced, free)
    columns = mapped(through.by_metal, by_path, least)
    columns += mapped(by_chain, [parameter for parameter in CHAIN_PARAMETERS if free[parameter]], least)
    if free[Parameter.DELRIN_PER_MM]:
        columns.append(through.by_transmission((-model.region.delrin_excess_mm * transmission).astype(np.float32)))
    if free[CURVATURE].any():
        by_bend = _derivatives_by_curvature(model, traced)[free[CURVATURE]]
        columns += [through.by_metal(model.region.on_rectangle(values, 0.0)) for values in by_bend]
    return columns


@dataclass(frozen=True, slots=True, eq=False)
class _ThroughChain:
    """What a small change of the transmission becomes in the compared pixels."""

    guide: NDArray[np.float32]  # transmission of the guide's body over the usual one, shape of the rectangle
    transmission: NDArray[np.float64]  # of metal and guide's body, shape of the rectangle
    images: ChainImages
    slope: NDArray[np.float32]  # of the display's curve, shape of the rectangle
    chain: ImagingChain
    sharpened_values: Callable[[NDArray[np.float32]], NDArray[np.float64]]

    @staticmethod
    def at(model: ForwardModel, traced: TracedTransmission) -> "_ThroughChain":
        """About traced rays."""
        chain = imaging_chain(model.region.sampling, traced.parameters)
        guide = guide_transmission(model, traced.parameters)
        transmission = traced.transmission * guide
        images = chain.steps(transmission)
        slope, guide_single = chain.tone_slope(images).astype(np.float32), guide.astype(np.float32)
        return _ThroughChain(guide_single, transmission, images, slope, chain, _sharpened_values(model, chain))

    def by_metal(self, change: NDArray[np.float32]) -> NDArray[np.float64]:
        """By a change of the metal's transmission."""
        return self.by_transmission(change * self.guide)

    def by_transmission(self, change: NDArray[np.float32]) -> NDArray[np.float64]:
        """By a change of the whole transmission."""
        return self.sharpened_values(self.slope * self.chain.blurred(change))


def _derivatives_by_curvature(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float32]:
    """Derivatives of the transmission of the support's pixels by the curvature towards y and z (1/m), shape (2, S)."""
    along_mm = _sections(model, traced)
    by_motion = traced.derivatives[:, :MOTION_SIZE]
    change, power = np.zeros((len(along_mm), 2)), along_mm.copy()
    for term in section_motions(curvature_of(traced.parameters)):
        change += power[:, None] * (by_motion @ term)
        power *= along_mm
    return np.ascontiguousarray(change.T, dtype=np.float32)


def _sections(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Arc lengths of the cross-sections in which the support's rays are traced, or would be in a bent nail, (S,)."""
    if traced.along_mm is not None:
        return traced.along_mm
    shape = nail_shape(model, traced.parameters)
    return section_places(model.nail, curvature_of(traced.parameters), model.region.rays, shape)


def turns_of_holes(count: int) -> NDArray[np.float64]:
    """Turn of each of so many holes by those against one another, which leave the mean as it is, (count, count - 1)."""
    return np.eye(count)[:, 1:] - 1.0 / count


def derivatives_by_hole_turns(model: ForwardModel, traced: TracedTransmission) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by turns (rad) of the holes against one another, about their own middles.

    Turns about either direction of `across_holes` follow one another for each column of `turns_of_holes`. A turn
    about the middle of a hole leaves the nail's surface where it is, to first order.
    """
    own = _by_own_turns(model, traced)
    turns = np.einsum("hk,hds->kds", turns_of_holes(len(own)).astype(np.float32), own)
    return _seen(model, traced, turns.reshape(-1, own.shape[-1]))


def derivatives_by_second_bores(
    model: ForwardModel, traced: TracedTransmission, directions: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by two bores in each hole, turned from their mean by as much (rad) either way.

    To first order metal is gone wherever one of them lies farther out than the mean. Turns about the directions, shape
    (K, 2) in terms of `across_holes`, follow one another for each hole.
    """
    own = _by_own_turns(model, traced)
    apart = np.abs(np.einsum("kd,hds->hks", directions.astype(np.float32), own))
    return _seen(model, traced, apart.reshape(-1, own.shape[-1]))


def derivatives_by_channels(
    model: ForwardModel, traced: TracedTransmission, widths: Sequence[float]
) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by what a channel along the beam lets through more, its logarithm, (N,) each.

    Channels through the middles of the holes follow one another for each width, as a share of the hole's.
    """
    region, camera_from_nail = model.region, model.pose(traced.parameters)
    nail = model.nail.bent(curvature_of(traced.parameters))
    rays = unit(np.column_stack([region.rays.slopes, np.ones(len(region.rays.slopes))]))
    transmission = traced.transmission.ravel()[region.support]

    def by_channel(width_share: float, hole: Hole) -> NDArray[np.float32]:
        middle_mm = camera_from_nail @ hole_axis(nail, hole).point_mm
        away_mm = np.linalg.norm(np.cross(rays, middle_mm), axis=1)
        pixel_mm = float(middle_mm[2]) / model.camera.focal_length_px * region.sampling.reduction
        inside = np.clip(0.5 + (0.5 * width_share * hole.diameter_mm - away_mm) / pixel_mm, 0.0, 1.0)
        return np.asarray(inside * transmission, dtype=np.float32)

    changes = [by_channel(width_share, hole) for width_share in widths for hole in nail.holes]
    return _seen(model, traced, np.stack(changes))


def _by_own_turns(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float32]:
    """Derivatives of the transmission of the support's pixels by turns of each hole about its middle, (H, 2, S)."""
    nail, along_mm, curvature = model.nail, _sections(model, traced), curvature_of(traced.parameters)
    own, across = np.zeros((len(nail.holes), 2, len(along_mm)), dtype=np.float32), across_holes(nail)
    for hole, change in zip(nail.holes, own, strict=True):
        x_mm = float(hole.axis.point_mm[0])
        middle_mm = hole.axis.point_mm - np.array([x_mm, 0.0, 0.0])
        motions = section_frame(curvature, x_mm).adjoint @ np.hstack([across, np.cross(middle_mm, across)]).T
        here = along_mm == x_mm
        change[:, here] = (traced.derivatives[here, :MOTION_SIZE] @ motions.astype(np.float32)).T
    return own


def _seen(model: ForwardModel, traced: TracedTransmission, changes: NDArray[np.float32]) -> list[NDArray[np.float64]]:
    """Changes of the support's transmission, shape (K, S), in the compared pixels."""
    through = _ThroughChain.at(model, traced)
    return [through.by_metal(model.region.on_rectangle(change, 0.0)) for change in changes]


def _transmission_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> Iterator[NDArray[np.float32]]:
    """Derivatives of the transmission by the free parameters that act on the paths, in their order."""
    causes = np.zeros((len(_PATH_PARAMETERS), DERIVATIVES))
    causes[:POSE_SIZE, :MOTION_SIZE] = model.motion_by_parameters(traced.parameters).T
    causes[POSE_SIZE:, MOTION_SIZE:] = np.eye(DERIVATIVES - MOTION_SIZE)
    causes[Parameter.CHAMFER_DEVIATIONS] *= chamfer(model.nail, traced.parameters)[1]
    for values in causes[free[: len(_PATH_PARAMETERS)]].astype(np.float32) @ traced.derivatives.T:
        yield model.region.on_rectangle(values, 0.0)


def _sharpened_values(model: ForwardModel, chain: ImagingChain) -> Callable[[NDArray[np.float32]], NDArray[np.float64]]:
    """The compared pixels of an image after edge enhancement; with whitening, both filters are applied as one."""
    if model.whitening is None:
        return lambda image: model.compared_values(chain.sharpened(image))
    both = model.whitening.after(chain.sharpened)
    return lambda image: model.region.compared_values(both.apply(image))
