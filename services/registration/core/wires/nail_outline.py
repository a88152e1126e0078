"""The nail's outline in an image: where its two edges should be, and where the image has them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.view import WireView, balls_mask, in_border
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform

_PROXIMAL_OF_HOLES_MM, _STEP_MM = 30.0, 0.5
_SAMPLES_PER_PX = 2.0
_BLUR_PX = 1.2
_BESIDE_PX = 5.0
_LEAST_STEP = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points on the nail's two edges, M in all.

    Attributes
    ----------
    point_px, outward
        Measured pixels, and unit directions away from the nail, shape (M, 2).
    point_nail_mm
        The same points on the nail, shape (M, 3).
    side
        0 or 1, which edge, shape (M,).
    """

    point_px: NDArray[np.float64]
    outward: NDArray[np.float64]
    point_nail_mm: NDArray[np.float64]
    side: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class OutlineMatch:
    """Where the image has the nail's edges.

    Attributes
    ----------
    index
        Points of the outline that have an edge, shape (N,).
    shift_px
        How far outwards it lies, shape (N,).
    share
        Of the points that can be seen, how many have one.
    """

    index: NDArray[np.int64]
    shift_px: NDArray[np.float64]
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class EdgeView:
    """An image prepared for finding the nail's edges: smoothed, and where nothing covers it."""

    view: WireView
    smooth: NDArray[np.float32]
    free: NDArray[np.bool_]


def edge_view(view: WireView, guide: GuidePart) -> EdgeView:
    """Smooth an image and mask balls and border."""
    smooth = np.asarray(cv2.GaussianBlur(view.pixels.astype(np.float32), (0, 0), _BLUR_PX), dtype=np.float32)
    return EdgeView(view, smooth, in_border(view.calibration) & ~balls_mask(view, guide))


def nail_outline(view: WireView, nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> Outline:
    """The edges of the nail's round bar about its holes, without its tip.

    A point at the nail's surface is on its outline when the ray to it touches the surface: its normal n, across the
    axis, fulfils n . c = -r for c from the focal spot to the axis.
    """
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    x = np.arange(min(along) - _PROXIMAL_OF_HOLES_MM, nail.tip_x_mm - nail.radius_mm, _STEP_MM)
    towards, distance = towards_axis(camera_from_nail)
    aside = np.cross([1.0, 0.0, 0.0], towards)
    sine = nail.radius_mm / distance
    points, outward, side = [], [], []
    for k, sign in enumerate((-1.0, 1.0)):
        normal = -sine * towards + sign * np.sqrt(1.0 - sine**2) * aside
        on_nail = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1) + nail.radius_mm * normal
        points.append(on_nail)
        shifted = image_of(view, camera_from_nail, on_nail + 0.1 * normal) - image_of(view, camera_from_nail, on_nail)
        way = np.gradient(image_of(view, camera_from_nail, on_nail), axis=0)
        across = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]
        outward.append(across * np.sign(np.sum(across * shifted, axis=1))[:, None])
        side.append(np.full(len(x), k))
    on_nail = np.concatenate(points)
    return Outline(image_of(view, camera_from_nail, on_nail), np.concatenate(outward), on_nail, np.concatenate(side))


def towards_axis(camera_from_nail: Transform[Camera, Nail]) -> tuple[NDArray[np.float64], float]:
    """Unit direction across the nail's axis from the focal spot to it, in the nail's frame, and the distance in mm."""
    source = camera_from_nail.inverse().translation_mm
    from_source = np.array([0.0, -source[1], -source[2]])
    distance = float(np.linalg.norm(from_source))
    return from_source / distance, distance


def match_outline(prepared: EdgeView, outline: Outline, reach_px: float) -> OutlineMatch:
    """Steepest brightening outwards within a reach of each point, where both sides are free.

    It counts when it is a good part of the median step: a wire or the guide's body beside the nail makes it smaller.
    """
    shifts = np.arange(-reach_px, reach_px + 1e-9, 1.0 / _SAMPLES_PER_PX)
    inside = _grey(prepared, outline.point_px + (shifts[:, None, None] - 1.0) * outline.outward)
    outside = _grey(prepared, outline.point_px + (shifts[:, None, None] + 1.0) * outline.outward)
    slope = outside - inside
    peak = np.clip(slope.argmax(axis=0), 1, len(shifts) - 2)
    column = np.arange(slope.shape[1])
    before, at, after = slope[peak - 1, column], slope[peak, column], slope[peak + 1, column]
    shift = shifts[peak] + 0.5 * (before - after) / np.minimum(before - 2.0 * at + after, -1e-12) / _SAMPLES_PER_PX
    edge = outline.point_px + shift[:, None] * outline.outward
    free = np.all([_free(prepared, edge + s * outline.outward) for s in (-_BESIDE_PX, 0.0, _BESIDE_PX)], axis=0)
    step = _grey(prepared, edge + _BESIDE_PX * outline.outward) - _grey(prepared, edge - _BESIDE_PX * outline.outward)
    usual = float(np.median(step[free])) if free.any() else 0.0
    good = free & (at >= before) & (at >= after) & (step > _LEAST_STEP * max(usual, 1e-9)) & (usual > 0.0)
    found = np.flatnonzero(good)
    return OutlineMatch(found, shift[found], len(found) / max(int(np.count_nonzero(free)), 1))


def image_of(
    view: WireView, camera_from_nail: Transform[Camera, Nail], points_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Measured pixels of points of the nail, shape (..., 3)."""
    return np.asarray(view.calibration.image_from_camera(camera_from_nail.points(points_mm)))


def _grey(prepared: EdgeView, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    flat = points_px.reshape(-1, points_px.shape[-2], 2).astype(np.float32)
    grey = cv2.remap(prepared.smooth, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(grey, dtype=np.float64).reshape(points_px.shape[:-1])


def _free(prepared: EdgeView, points_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    rows, columns = prepared.free.shape
    x, y = np.rint(points_px[:, 0]).astype(np.int64), np.rint(points_px[:, 1]).astype(np.int64)
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    return np.asarray(inside & prepared.free[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)])
