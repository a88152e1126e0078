"""What is known of one set-up before its wires are looked at: the guide in each image, the nail in the guide's frame.

The errors of both belong together: where the nail's place comes from an image, the guide's error in that image is in
it. Whoever compares a wire, found with the help of the guide, with the nail's holes must know that.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.images import OUTLINE_CHI_SQUARE, chi_square_limit
from services.registration.core.acceptance.wires import OUTLINE_SHARE
from services.registration.core.estimation.joint import JointEstimate
from services.registration.core.wires.image import WireView
from services.registration.core.wires.nail_outline import (
    EdgeView,
    Outline,
    edge_view,
    image_of,
    match_outline,
    nail_outline,
    towards_axis,
)
from shared.errors import Reason
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import cross_matrix, read_only
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """Images of one set-up with the guide's pose in each, and the nail in the guide's frame.

    Attributes
    ----------
    covariance
        Of small motions (rotation in rad, translation in mm): of the guide in its own frame in the first view, in the
        second ..., and of the nail in its own frame; shape (6 V + 6, 6 V + 6).
    """

    views: tuple[WireView, ...]
    guide_from_nail: Transform[Guide, Nail]
    covariance: NDArray[np.float64]

    def __post_init__(self) -> None:
        size = 6 * len(self.views) + 6
        if self.covariance.shape != (size, size):
            raise ValueError(f"expected a covariance of shape ({size}, {size}), got {self.covariance.shape}")
        object.__setattr__(self, "covariance", read_only(self.covariance))

    @property
    def nail_covariance(self) -> NDArray[np.float64]:
        """Of `guide_from_nail`, shape (6, 6)."""
        return self.covariance[-6:, -6:]

    def camera_from_nail(self, view: int) -> Transform[Camera, Nail]:
        """Where the nail is in one view."""
        return self.views[view].camera_from_guide @ self.guide_from_nail

    def moved(self, motion: NDArray[np.float64], covariance: NDArray[np.float64]) -> "SetUp":
        """Everything after small motions, shape (6 V + 6,), with the covariance that is left."""
        views = []
        for k, view in enumerate(self.views):
            own = motion[6 * k : 6 * k + 6]
            views.append(
                WireView(
                    view.pixels,
                    view.calibration,
                    view.camera_from_guide.moved(own),
                    covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6],
                )
            )
        return SetUp(tuple(views), self.guide_from_nail.moved(motion[-6:]), covariance)


def set_up_of(views: tuple[WireView, ...], joint: JointEstimate[Guide, Nail], source: tuple[int | None, ...]) -> SetUp:
    """Put the views together with what several images, or one, said of the nail.

    Parameters
    ----------
    source
        For each view, which of the images of `joint` it is; None for an image in which the nail could not be found.
    """
    size = 6 * len(views) + 6
    covariance = np.zeros((size, size))
    covariance[-6:, -6:] = joint.pose.covariance
    by_guide = joint.pose.mean.inverse().adjoint
    for k, (view, image) in enumerate(zip(views, source, strict=True)):
        own = slice(6 * k, 6 * k + 6)
        covariance[own, own] = view.guide_covariance
        if image is not None:
            # The image's pose has the guide's error, seen from the nail, with the sign turned round.
            covariance[own, -6:] = -view.guide_covariance @ by_guide.T @ joint.weights[image].T
            covariance[-6:, own] = covariance[own, -6:].T
    return SetUp(views, joint.pose.mean, covariance)


_REACHES_PX = (14.0, 8.0, 5.0, 4.0, 3.0)
_EDGE_SD_PX, _EDGE_CORRELATION_PX, _ROBUST_PX = 0.3, 6.0, 1.0
# The display's curve moves both edges outwards or inwards alike; what lies beside them moves each for itself.
_BOTH_EDGES_SD_PX, _ONE_EDGE_SD_PX = 0.7, 0.15
# What an outline does not tell, such as a shift along the nail, is as good as unknown: rad and mm.
_UNKNOWN = np.diag([1.0] * 3 + [1000.0**-2] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class BandDeparture:
    """How far the band that an image shows lies from where the guide in it and the other images put the nail.

    Attributes
    ----------
    motion
        Across the nail's axis and the ray, midway between the holes (mm), and about the ray (rad), shape (2,).
    covariance
        Of it, when nothing moved, shape (2, 2).
    share
        Of the outline that can be seen, how much has an edge.
    """

    motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    share: float

    def __post_init__(self) -> None:
        for name in ("motion", "covariance"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def chi_square(self) -> float:
        """Of two degrees of freedom."""
        return float(self.motion @ np.linalg.solve(self.covariance, self.motion))

    def reason(self, image: str) -> Reason | None:
        """Why the guide is not where it was when the nail was seen from it; None when it may be."""
        limit = chi_square_limit(len(self.motion))
        (shift_mm, turn_rad), (shift_sd_mm, turn_sd_rad) = np.abs(self.motion), np.sqrt(np.diag(self.covariance))
        measured = (
            f"in image {image} the nail lies {shift_mm:.2f} mm and {np.degrees(turn_rad):.2f}° from where the guide in "
            f"it and the holes in other images put it (standard deviations {shift_sd_mm:.2f} mm and "
            f"{np.degrees(turn_sd_rad):.2f}°, chi-square {OUTLINE_CHI_SQUARE.quoted(self.chi_square, limit)})"
        )
        if not OUTLINE_SHARE.is_met(self.share):
            measured = (
                f"in image {image} {OUTLINE_SHARE.quoted(self.share)} of the nail's outline is where the guide in it "
                "and the holes in other images put it"
            )
        elif OUTLINE_CHI_SQUARE.is_met(self.chi_square, limit):
            return None
        return OUTLINE_SHARE.reason(
            f"{measured}; the guide moved on the bone between the images or one of them is wrong"
        )


@dataclass(frozen=True, slots=True, eq=False)
class OutlinedSetUp:
    """A set-up corrected by the nail's outline in one view, and how far it had to be."""

    set_up: SetUp
    departure: BandDeparture


def with_outline(set_up: SetUp, view: int, guide: GuidePart, nail: NailPart) -> OutlinedSetUp:
    """Correct a set-up by the nail's outline in one view."""
    prepared = edge_view(set_up.views[view], guide)
    prior = np.linalg.inv(set_up.covariance)
    motion = np.zeros(len(prior))
    for reach_px in _REACHES_PX:
        now = set_up.moved(motion, set_up.covariance)
        chained = np.zeros((6, len(prior)))
        chained[:, 6 * view : 6 * view + 6] = now.guide_from_nail.inverse().adjoint
        chained[:, -6:] = np.eye(6)
        told = _information(prepared, nail, now.camera_from_nail(view), reach_px)
        normal = prior + chained.T @ told.normal @ chained
        seen_from_here = np.linalg.solve(told.normal + _UNKNOWN, told.gradient)
        seen = chained @ motion + seen_from_here
        motion = motion + np.linalg.solve(normal, chained.T @ told.gradient - prior @ motion)
    band = _band_of(now.camera_from_nail(view))
    covariance = np.linalg.inv(told.normal + _UNKNOWN) + chained @ set_up.covariance @ chained.T
    departure = BandDeparture(band @ seen, band @ covariance @ band.T, told.share)
    return OutlinedSetUp(set_up.moved(motion, np.asarray(np.linalg.inv(normal))), departure)


def _band_of(camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """What a band shows of a small motion of the nail in its own frame: shift across and turn about the ray, (2, 6)."""
    towards, _ = towards_axis(camera_from_nail)
    shows = np.zeros((2, 6))
    shows[0, 3:] = np.cross([1.0, 0.0, 0.0], towards)
    shows[1, :3] = towards
    return shows


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """What an outline says of a small motion of the nail in its own frame: normal matrix (6, 6), gradient (6,)."""

    normal: NDArray[np.float64]
    gradient: NDArray[np.float64]
    share: float


def _information(
    prepared: EdgeView, nail: NailPart, camera_from_nail: Transform[Camera, Nail], reach_px: float
) -> _Told:
    """Match the outline within a reach; the two edges' own errors are eliminated."""
    outline = nail_outline(prepared.view, nail, camera_from_nail)
    match = match_outline(prepared, outline, reach_px)
    if len(match.index) == 0:
        return _Told(np.zeros((6, 6)), np.zeros(6), match.share)
    chosen = match.index
    J = np.zeros((len(chosen), 9))
    J[:, :6] = _derivative(prepared.view, camera_from_nail, outline, chosen)
    J[:, 6] = 1.0
    J[np.arange(len(chosen)), 7 + outline.side[chosen]] = 1.0
    apart_px = float(np.median(np.linalg.norm(np.diff(outline.point_px, axis=0), axis=1)))
    crowding = max(_EDGE_CORRELATION_PX / max(apart_px, 1e-6), 1.0)
    own_sd_px = np.array([_BOTH_EDGES_SD_PX, _ONE_EDGE_SD_PX, _ONE_EDGE_SD_PX])
    weight = match.counts / (_EDGE_SD_PX**2 * crowding * (1.0 + (match.shift_px / _ROBUST_PX) ** 2))
    normal = J.T @ (weight[:, None] * J) + np.diag(np.concatenate([np.zeros(6), own_sd_px**-2]))
    gradient = J.T @ (weight * match.shift_px)
    eliminated = np.linalg.solve(normal[6:, 6:], np.column_stack([normal[6:, :6], gradient[6:]]))
    reduced = normal[:6, :6] - normal[:6, 6:] @ eliminated[:, :6]
    return _Told(np.asarray(reduced), np.asarray(gradient[:6] - normal[:6, 6:] @ eliminated[:, 6]), match.share)


def _derivative(
    view: WireView, camera_from_nail: Transform[Camera, Nail], outline: Outline, chosen: NDArray[np.int64]
) -> NDArray[np.float64]:
    """How points of the outline move outwards with small motions of the nail in its own frame, shape (N, 6)."""
    points, outward = outline.point_nail_mm[chosen], outline.outward[chosen]
    here = outline.point_px[chosen]
    by_axis = np.stack(
        [
            np.sum((image_of(view, camera_from_nail, points + 0.01 * step) - here) * outward, axis=1) / 0.01
            for step in np.eye(3)
        ],
        axis=1,
    )
    turned = np.stack([-cross_matrix(point) for point in points])
    return np.concatenate([np.einsum("ni,nij->nj", by_axis, turned), by_axis], axis=1)
