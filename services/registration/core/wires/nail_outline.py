"""The nail's outline in an image: where its two edges should be, and where the image has them."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.subpixel import between_pixels, peaks_of, profile_px, ramp
from services.registration.core.wires.image import WireView, balls_mask, in_border
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform

_PROXIMAL_OF_HOLES_MM, _STEP_MM = 30.0, 0.5
_BLUR_PX = 1.2
_BESIDE_PX = 5.0
# Up to where an edge does not count, and from where on it counts whole: its step over the usual one.
_STEP = (0.3, 0.4)


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
    counts
        How much each counts, above 0 and up to 1, shape (N,).
    shift_px
        How far outwards it lies, shape (N,).
    share
        Of the outline that can be seen, how much has an edge; points that count in part are parts of both.
    """

    index: NDArray[np.int64]
    counts: NDArray[np.float64]
    shift_px: NDArray[np.float64]
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class EdgeView:
    """An image prepared for finding the nail's edges: smoothed, and 1 where nothing covers it, else 0."""

    view: WireView
    smooth: NDArray[np.float32]
    free: NDArray[np.float32]


def edge_view(view: WireView, guide: GuidePart) -> EdgeView:
    """Smooth an image and mask balls and border."""
    smooth = np.asarray(cv2.GaussianBlur(view.pixels.astype(np.float32), (0, 0), _BLUR_PX), dtype=np.float32)
    free = in_border(view.calibration) & ~balls_mask(view, guide)
    return EdgeView(view, smooth, free.astype(np.float32))


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

    It counts the less, the less it is of the median step (a wire or the guide's body beside the nail makes it smaller),
    and the more of it is covered; `share` is what counts of what is free.
    """
    shifts = profile_px(reach_px)[:, None]
    point, outward = outline.point_px[:, None, :], outline.outward[:, None, :]
    inside, outside = (between_pixels(prepared.smooth, point + (shifts + way) * outward) for way in (-1.0, 1.0))
    peaks = peaks_of(outside - inside, shifts[:, 0])
    edge = outline.point_px + peaks.place[:, None] * outline.outward
    beside = [edge + way_px * outline.outward for way_px in (-_BESIDE_PX, 0.0, _BESIDE_PX)]
    free = np.prod([between_pixels(prepared.free, place) for place in beside], axis=0)
    step = between_pixels(prepared.smooth, beside[2]) - between_pixels(prepared.smooth, beside[0])
    clear = step[free == 1.0]
    usual = float(np.median(clear)) if clear.size else 0.0
    counts = free * (peaks.inside & (usual > 0.0)) * ramp(step / max(usual, 1e-9), *_STEP)
    found = np.flatnonzero(counts)
    return OutlineMatch(found, counts[found], peaks.place[found], float(counts.sum() / max(free.sum(), 1.0)))


def image_of(
    view: WireView, camera_from_nail: Transform[Camera, Nail], points_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Measured pixels of points of the nail, shape (..., 3)."""
    return np.asarray(view.calibration.image_from_camera(camera_from_nail.points(points_mm)))
