"""Where the outline of a K-wire should appear in an image, and where the image has it.

A wire is a stack of discs along its axis. Its outline is the envelope of their images: two sides, and a cap at either
end; seen nearly end on, one cap is all there is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.view import PreparedView

_CAP_DIRECTIONS = 36
_SAMPLES_PER_PX = 1.5
_CLEAR_OF_MASK_PX = 1.0
_LEAST_STRENGTH = 4.0
_LEAST_DARKNESS, _INSIDE, _OUTSIDE = 0.4, 0.7, 0.6


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
    """

    disc: NDArray[np.int64]
    outward: NDArray[np.float64]
    point_px: NDArray[np.float64]

    def length_px(self, stack: Stack) -> NDArray[np.float64]:
        """Length of outline that each point stands for, shape (M,)."""
        way = np.linalg.norm(np.gradient(stack.centre_px, axis=0), axis=1)
        at_an_end = (self.disc == 0) | (self.disc == len(way) - 1)
        along_cap = stack.radius_px[self.disc] * (2.0 * np.pi / _CAP_DIRECTIONS)
        return np.where(at_an_end, along_cap, way[self.disc])


@dataclass(frozen=True, slots=True, eq=False)
class EdgeMatches:
    """Where the image has an edge near points of an outline.

    Attributes
    ----------
    index
        Points of the outline that have one, shape (N,).
    shift_px
        How far outwards it lies, shape (N,).
    darkness
        How dark the wire is just inside, between the nail's metal (1) and what lies just outside (0), shape (N,).
    """

    index: NDArray[np.int64]
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
    first, last = _cap(along[0], lean[0], -1.0), _cap(along[-1], lean[-1], 1.0)
    end = len(length) - 1
    disc = np.concatenate([has_sides, has_sides, np.zeros(len(first), int), np.full(len(last), end)])
    outward = np.concatenate([*sides, first, last])
    points = stack.centre_px[disc] + stack.radius_px[disc][:, None] * outward
    return Outline(disc.astype(np.int64), outward, points)


def _cap(along: NDArray[np.float64], lean: float, sense: float) -> NDArray[np.float64]:
    """Directions, shape (C, 2), in which a disc at the end of a stack is the outline."""
    angle = np.linspace(0.0, 2.0 * np.pi, _CAP_DIRECTIONS, endpoint=False)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return outward[sense * (outward @ along - lean) > 0.0]


def match_edges(prepared: PreparedView, stack: Stack, outline: Outline, reach_px: float) -> EdgeMatches:
    """Steepest brightening outwards within a reach of each point of an outline, where the view is free.

    It counts where it is well above the image's texture and the wire is dark inside it: steel is, bone is not.
    """
    shifts = np.arange(-reach_px, reach_px + 1e-9, 1.0 / _SAMPLES_PER_PX)
    where = outline.point_px[:, None, :] + shifts[None, :, None] * outline.outward[:, None, :]
    slope = prepared.outward_slope(where, np.broadcast_to(outline.outward[:, None, :], where.shape))
    slope = np.where(prepared.is_free(where), slope, 0.0)
    peak = np.clip(slope.argmax(axis=1), 1, len(shifts) - 2)
    row = np.arange(len(peak))
    before, at, after = slope[row, peak - 1], slope[row, peak], slope[row, peak + 1]
    edge = outline.point_px + shifts[peak][:, None] * outline.outward
    good = (at >= _LEAST_STRENGTH * prepared.noise) & (at >= before) & (at >= after)
    for sense in (-1.0, 1.0):
        good &= prepared.is_free(edge + sense * _CLEAR_OF_MASK_PX * outline.outward)
    radius = stack.radius_px[outline.disc][:, None]
    inside = prepared.grey(edge - _INSIDE * radius * outline.outward)
    outside = prepared.grey(edge + _OUTSIDE * radius * outline.outward)
    darkness = (outside - inside) / np.maximum(outside - prepared.metal_grey, 1e-9)
    good &= darkness >= _LEAST_DARKNESS
    bend = np.minimum(before - 2.0 * at + after, -1e-12)
    shift = shifts[peak] + 0.5 * (before - after) / bend / _SAMPLES_PER_PX
    found = np.flatnonzero(good)
    return EdgeMatches(found, shift[found], darkness[found])
