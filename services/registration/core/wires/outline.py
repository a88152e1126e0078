"""Where the outline of a K-wire should appear in an image, and where the image has it.

A wire is a stack of discs along its axis. Its outline is the envelope of their images: two sides, and a cap at either
end; seen nearly end on, one cap is all there is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.subpixel import peaks_of, profile_px, ramp
from services.registration.core.wires.image import PreparedView
from services.registration.core.wires.model import SHARED, WireModel

_CAP_POINTS = 24
_CLEAR_OF_MASK_PX = 1.25
# Up to where a point does not count, and from where on it counts whole: its slope over the texture's, its darkness.
_STRENGTH, _DARKNESS = (3.5, 4.5), (0.35, 0.45)
_INSIDE, _OUTSIDE = 0.7, 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """Discs along a wire in one image.

    Attributes
    ----------
    centre_px
        Measured pixels, shape (K, 2).
    radius_px
        Shape (K,).
    """

    centre_px: NDArray[np.float64]
    radius_px: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points on a wire's outline.

    Attributes
    ----------
    disc
        Index of the disc of the stack that each point lies on, shape (M,).
    outward
        Unit direction away from the wire, shape (M, 2).
    point_px
        Shape (M, 2).
    length_px
        Length of outline that each point stands for, shape (M,).
    """

    disc: NDArray[np.int64]
    outward: NDArray[np.float64]
    point_px: NDArray[np.float64]
    length_px: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class EdgeMatches:
    """Where the image has an edge near points of an outline.

    Attributes
    ----------
    index
        Points of the outline that have one, shape (N,).
    share
        How much each counts, above 0 and up to 1: yes and no would make the likelihood of a wire jump, shape (N,).
    shift_px
        How far outwards it lies, shape (N,).
    darkness
        How dark the wire is just inside, between the nail's metal (1) and what lies just outside (0), shape (N,).
    """

    index: NDArray[np.int64]
    share: NDArray[np.float64]
    shift_px: NDArray[np.float64]
    darkness: NDArray[np.float64]


def outline_of(stack: Stack) -> Outline:
    """Envelope of a stack of discs: where neighbouring discs touch it, and both caps."""
    step = np.gradient(stack.centre_px, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    along = step / length[:, None]
    # The envelope's normal leans forward by as much as the discs shrink per pixel of way.
    lean = -np.gradient(stack.radius_px) / length
    has_sides = np.flatnonzero(np.abs(lean) < 1.0)[1:-1]
    upright = np.sqrt(np.maximum(1.0 - lean[has_sides] ** 2, 0.0))[:, None]
    t, n = along[has_sides], np.stack([-along[has_sides, 1], along[has_sides, 0]], axis=-1)
    forward = lean[has_sides][:, None] * t
    sides = [forward + upright * n, forward - upright * n]
    (first, first_rad), (last, last_rad) = _cap(-along[0], -lean[0]), _cap(along[-1], lean[-1])
    end = len(length) - 1
    disc = np.concatenate([has_sides, has_sides, np.repeat([0, end], _CAP_POINTS)])
    outward = np.concatenate([*sides, first, last])
    points = stack.centre_px[disc] + stack.radius_px[disc][:, None] * outward
    caps_px = np.repeat([stack.radius_px[0] * first_rad, stack.radius_px[end] * last_rad], _CAP_POINTS)
    # of the tangent to two neighbouring discs, between the points where it touches them
    side_px = length[has_sides] * upright[:, 0]
    length_px = np.concatenate([side_px, side_px, caps_px])
    return Outline(disc.astype(np.int64), outward, points, length_px)


def _cap(towards_end: NDArray[np.float64], lean: float) -> tuple[NDArray[np.float64], float]:
    """Directions, shape (C, 2), in which a disc at the end of a stack is the outline, and how far apart they are.

    As many at all times, so that nothing jumps when the wire turns: seen end on, all around the one disc, and nowhere
    around the other.
    """
    half_rad = float(np.arccos(np.clip(lean, -1.0, 1.0)))
    angle = half_rad * ((2.0 * np.arange(_CAP_POINTS) + 1.0) / _CAP_POINTS - 1.0)
    beside = np.array([-towards_end[1], towards_end[0]])
    return np.cos(angle)[:, None] * towards_end + np.sin(angle)[:, None] * beside, 2.0 * half_rad / _CAP_POINTS


def match_edges(prepared: PreparedView, stack: Stack, outline: Outline, reach_px: float) -> EdgeMatches:
    """Steepest brightening outwards within a reach of each point of an outline, where the view is free.

    It counts where it is well above the image's texture and the wire is dark inside it: steel is, bone is not.
    """
    shifts = profile_px(reach_px)
    where = outline.point_px[:, None, :] + shifts[None, :, None] * outline.outward[:, None, :]
    slope = prepared.outward_slope(where, np.broadcast_to(outline.outward[:, None, :], where.shape))
    slope = np.where(prepared.free_share(where) > 0.0, slope, 0.0)
    peaks = peaks_of(slope, shifts)
    edge = outline.point_px + peaks.place[:, None] * outline.outward
    share = ramp(peaks.height / prepared.noise, *_STRENGTH) * peaks.inside
    for sense in (-1.0, 1.0):
        share *= prepared.free_share(edge + sense * _CLEAR_OF_MASK_PX * outline.outward)
    radius = stack.radius_px[outline.disc][:, None]
    inside = prepared.grey(edge - _INSIDE * radius * outline.outward)
    outside = prepared.grey(edge + _OUTSIDE * radius * outline.outward)
    darkness = (outside - inside) / np.maximum(outside - prepared.metal_grey, 1e-9)
    share *= ramp(darkness, *_DARKNESS)
    found = np.flatnonzero(share)
    return EdgeMatches(found, share[found], peaks.place[found], darkness[found])


PER_VIEW = 7
# Farther apart, the likelihood of one place would depend by some nats on which points of the outline happen to be read.
_LEAST_DISCS, _MOST_DISCS, _DISC_EVERY_PX = 12, 500, 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A wire's outline in one view.

    Attributes
    ----------
    free
        How much of each point can be seen, and counts, from 0 to 1, shape (M,).
    """

    stack: Stack
    outline: Outline
    free: NDArray[np.float64]

    @property
    def free_px(self) -> NDArray[np.float64]:
        """Length of outline that each point stands for and that can be seen, shape (M,)."""
        return self.outline.length_px * self.free


def stacks_of(view: PreparedView, model: WireModel, unknowns: NDArray[np.float64], count: int) -> Stack:
    """Discs along wires: centres of shape (B, count, 2), radii of shape (B, count).

    Parameters
    ----------
    unknowns
        Shape (B, 13): of the wire (see `WireModel`), then the error of the apparent radius in this view (px), then that
        of the guide's pose (rad, mm, in the guide's own frame).
    """
    points = model.points_guide_mm(unknowns[:, :SHARED], count)
    turn, shift = unknowns[:, None, SHARED + 1 : SHARED + 4], unknowns[:, None, SHARED + 4 :]
    # The guide's pose is wrong by a hundredth of a degree: the turn's first order is exact to nanometres.
    points_camera = view.camera_points_mm(points + np.cross(turn, points) + shift)
    calibration = view.view.calibration
    distance = np.linalg.norm(points_camera, axis=-1)
    radius = model.radius_mm * calibration.camera.focal_length_px / distance + unknowns[:, SHARED, None]
    return Stack(calibration.image_from_camera(points_camera), radius)


def shape_of(view: PreparedView, model: WireModel, unknowns: NDArray[np.float64]) -> Shape:
    """Outline of one wire, by a disc every pixel and a half."""
    rough = stacks_of(view, model, unknowns[None], 3).centre_px[0]
    way_px = float(np.linalg.norm(np.diff(rough, axis=0), axis=1).sum())
    discs = int(np.clip(way_px / _DISC_EVERY_PX, _LEAST_DISCS, _MOST_DISCS))
    stacks = stacks_of(view, model, unknowns[None], discs)
    return shape_in(view, Stack(stacks.centre_px[0], stacks.radius_px[0]))


def shape_in(view: PreparedView, stack: Stack) -> Shape:
    """Outline of one stack of discs."""
    outline = outline_of(stack)
    # The cap at the begin of the wire does not count: where it is, nobody knows.
    free = view.free_share(outline.point_px) * (outline.disc > 0)
    return Shape(stack, outline, free)


_SEARCH_REACH_MM, _SEARCH_STEP_MM, _SEARCH_REACH_PX = 8.0, 0.8, 3.0
_OTHER_TIPS_MM = (-10.0, 10.0)
_SEARCH_DISCS = 40
_CANDIDATES, _STARTS, _STARTS_APART_MM = 40, 5, 1.0
_PENALTY_OF_MISSING = 0.5


def search_starts(views: tuple[PreparedView, ...], model: WireModel) -> list[NDArray[np.float64]]:
    """Best axes of a grid through the middle of the guide hole, apart from one another, for a few places of the tip."""
    steps = np.arange(-_SEARCH_REACH_MM, _SEARCH_REACH_MM + 1e-9, _SEARCH_STEP_MM)
    scored = _ranked(views, model, [(x, y, 0.0) for x in steps for y in steps])[:_CANDIDATES]
    others = [(x, y, tip) for _, (x, y, _) in scored for tip in _OTHER_TIPS_MM]
    chosen: list[tuple[float, float, float]] = []
    for _, place in sorted(scored + _ranked(views, model, others), reverse=True):
        if all(np.hypot(place[0] - x, place[1] - y) > _STARTS_APART_MM for x, y, _ in chosen):
            chosen.append(place)
    return [_unknowns_at(model, place) for place in chosen[:_STARTS]]


def _ranked(
    views: tuple[PreparedView, ...], model: WireModel, places: list[tuple[float, float, float]]
) -> list[tuple[float, tuple[float, float, float]]]:
    """Scores of places at the nail (two offsets, and how far the tip is past its usual place, in mm), best first."""
    unknowns = np.array([_unknowns_at(model, place) for place in places])
    deviation = unknowns - model.mean
    scores = -0.5 * np.einsum("bi,ij,bj->b", deviation, model.precision, deviation)
    in_view = np.concatenate([unknowns, np.zeros((len(places), PER_VIEW))], axis=1)
    for view in views:
        stacks = stacks_of(view, model, in_view, _SEARCH_DISCS)
        pairs = zip(stacks.centre_px, stacks.radius_px, strict=True)
        scores += [_evidence_px(view, Stack(centre_px, radius_px)) for centre_px, radius_px in pairs]
    return sorted(zip(scores.tolist(), places, strict=True), reverse=True)


def _unknowns_at(model: WireModel, place: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(model.mean + np.array([0.0, 0.0, place[0], place[1], 0.0, place[2]]))


def _evidence_px(view: PreparedView, stack: Stack) -> float:
    shape = shape_in(view, stack)
    matches = match_edges(view, shape.stack, shape.outline, _SEARCH_REACH_PX)
    seen_px = float(matches.share @ shape.free_px[matches.index])
    return seen_px - _PENALTY_OF_MISSING * float(shape.free_px.sum())
