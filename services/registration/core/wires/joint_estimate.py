"""Joint estimate of the guide's pose in every image and of the nail's pose in the guide's frame.

The errors of both are correlated: where the nail's pose comes from an image, the guide's error in that image is part of
it. A wire that was found with the help of the guide is compared with the nail's holes by the joint covariance.

An image that does not show the holes still shows the nail as a band. Its two edges determine the nail's place across
that direction, which a lateral image determines poorly (the depth, and one tilt), and correct the guide's pose where
the wires end, far from the guide's balls. A band that lies elsewhere than predicted shows that the guide has moved.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import OUTLINE_CHI_SQUARE, OUTLINE_SHARE, chi_square_limit
from services.registration.core.estimation.joint import JointEstimate
from services.registration.core.estimation.robust import robust_weight
from services.registration.core.tuning import NAIL_OUTLINE_MATCHING
from services.registration.core.wires.image import RegisteredImage
from services.registration.core.wires.nail_outline import (
    NailOutline,
    SmoothImage,
    match_nail_outline,
    nail_outline,
    smooth_image,
    towards_axis,
)
from shared.errors import Reason
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import read_only
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels

# An outline does not determine all motions, such as a shift along the nail: a broad prior (1 rad, 1 m) for the rest.
_BROAD_PRIOR = np.diag([1.0] * 3 + [1000.0**-2] * 3)
_DERIVATIVE_STEP_MM = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class JointRegistration:
    """Images with the guide's pose in each, and the nail in the guide's frame."""

    images: tuple[RegisteredImage, ...]
    guide_from_nail: Transform[Guide, Nail]
    # Of small motions (rotation in rad, translation in mm): of the guide in its own frame in the first image, in the
    # second ..., and of the nail in its own frame; shape (6 V + 6, 6 V + 6)
    covariance: NDArray[np.float64]
    curvature_per_m: tuple[float, float] = (0.0, 0.0)  # of the nail towards its y and z
    # Of pose and curvature before any image corrected the pose, shape (8, 8); None where no curvature was estimated
    covariance_with_bend: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        size = 6 * len(self.images) + 6
        if self.covariance.shape != (size, size):
            raise ValueError(f"expected a covariance of shape ({size}, {size}), got {self.covariance.shape}")
        object.__setattr__(self, "covariance", read_only(self.covariance))

    def camera_from_nail(self, image: int) -> Transform[Camera, Nail]:
        """The nail's pose in one image."""
        return self.images[image].camera_from_guide @ self.guide_from_nail

    def moved(self, motion: NDArray[np.float64], covariance: NDArray[np.float64]) -> "JointRegistration":
        """The estimate after small motions, shape (6 V + 6,), with their posterior covariance."""
        own = [slice(6 * k, 6 * k + 6) for k in range(len(self.images))]
        images = tuple(
            replace(
                image, camera_from_guide=image.camera_from_guide.moved(motion[k]), guide_covariance=covariance[k, k]
            )
            for image, k in zip(self.images, own, strict=True)
        )
        return replace(
            self, images=images, guide_from_nail=self.guide_from_nail.moved(motion[-6:]), covariance=covariance
        )


def joint_registration(
    images: tuple[RegisteredImage, ...], fused: JointEstimate[Guide, Nail], source: tuple[int | None, ...]
) -> JointRegistration:
    """Combine the images with the nail's pose fused from several images, or from one.

    The source of each image is its index in `fused`; None for an image in which the nail was not found.
    """
    size = 6 * len(images) + 6
    covariance = np.zeros((size, size))
    covariance[-6:, -6:] = fused.pose.covariance
    by_guide = fused.pose.mean.inverse().adjoint
    for k, (image, index) in enumerate(zip(images, source, strict=True)):
        own = slice(6 * k, 6 * k + 6)
        covariance[own, own] = image.guide_covariance
        if index is not None:
            # The image's pose contains the guide's error, transported to the nail, with the opposite sign.
            covariance[own, -6:] = -image.guide_covariance @ by_guide.T @ fused.weights[index].T
            covariance[-6:, own] = covariance[own, -6:].T
    return JointRegistration(images, fused.pose.mean, covariance, fused.curvature_per_m, fused.covariance_with_bend)


@dataclass(frozen=True, slots=True, eq=False)
class OutlineInnovation:
    """Observed minus predicted place of the nail's band in one image."""

    # Across the nail's axis and the ray, midway between the holes (mm), and about the ray (rad), shape (2,)
    motion: NDArray[np.float64]
    covariance: NDArray[np.float64]  # of it, if nothing moved, shape (2, 2)
    found_fraction: float  # fraction of the visible outline that has an edge

    def __post_init__(self) -> None:
        object.__setattr__(self, "motion", read_only(self.motion))
        object.__setattr__(self, "covariance", read_only(self.covariance))

    @property
    def chi_square(self) -> float:
        """Of two degrees of freedom."""
        return float(self.motion @ np.linalg.solve(self.covariance, self.motion))

    def reason(self, image: str) -> Reason | None:
        """Why the guide is not where it was when the nail was observed with it; None when it may be."""
        limit = chi_square_limit(len(self.motion))
        (shift_mm, turn_rad), (shift_sd_mm, turn_sd_rad) = np.abs(self.motion), np.sqrt(np.diag(self.covariance))
        measured = (
            f"in image {image} the nail lies {shift_mm:.2f} mm and {np.degrees(turn_rad):.2f}° from where the guide in "
            f"it and the holes in other images put it (standard deviations {shift_sd_mm:.2f} mm and "
            f"{np.degrees(turn_sd_rad):.2f}°, chi-square {OUTLINE_CHI_SQUARE.quoted(self.chi_square, limit)})"
        )
        if not OUTLINE_SHARE.is_met(self.found_fraction):
            measured = (
                f"in image {image} {OUTLINE_SHARE.quoted(self.found_fraction)} of the nail's outline is where the "
                "guide in it and the holes in other images put it"
            )
        elif OUTLINE_CHI_SQUARE.is_met(self.chi_square, limit):
            return None
        return OUTLINE_SHARE.reason(
            f"{measured}; the guide moved on the bone between the images or one of them is wrong"
        )


def update_with_outline(
    estimate: JointRegistration, image: int, guide: GuidePart, nail: NailPart
) -> tuple[JointRegistration, OutlineInnovation]:
    """Condition a joint estimate on the nail's outline in one image, by iterated least squares; also the innovation."""
    smooth = smooth_image(estimate.images[image], guide)
    prior = np.linalg.inv(estimate.covariance)
    motion = np.zeros(len(prior))
    for reach_mm in NAIL_OUTLINE_MATCHING.reaches_detector_mm:
        now = estimate.moved(motion, estimate.covariance)
        chained = np.zeros((6, len(prior)))
        chained[:, 6 * image : 6 * image + 6] = now.guide_from_nail.inverse().adjoint
        chained[:, -6:] = np.eye(6)
        of_image, gradient, share = _information(smooth, nail, now.camera_from_nail(image), reach_mm)
        normal = prior + chained.T @ of_image @ chained
        observed_motion = chained @ motion + np.linalg.solve(of_image + _BROAD_PRIOR, gradient)
        motion = motion + np.linalg.solve(normal, chained.T @ gradient - prior @ motion)
    band = _determined_by_band(now.camera_from_nail(image))
    covariance = np.linalg.inv(of_image + _BROAD_PRIOR) + chained @ estimate.covariance @ chained.T
    innovation = OutlineInnovation(band @ observed_motion, band @ covariance @ band.T, share)
    return estimate.moved(motion, np.asarray(np.linalg.inv(normal))), innovation


def _determined_by_band(camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """What a band determines of a small motion of the nail: shift across and turn about the ray, shape (2, 6)."""
    towards, _ = towards_axis(camera_from_nail)
    rows = np.zeros((2, 6))
    rows[0, 3:] = np.cross([1.0, 0.0, 0.0], towards)
    rows[1, :3] = towards
    return rows


def _information(
    image: SmoothImage, nail: NailPart, camera_from_nail: Transform[Camera, Nail], reach_detector_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Information of the outline about a small motion of the nail in its own frame, and the share that was found.

    Normal matrix, shape (6, 6), and gradient, shape (6,), from matches within a reach; the two edges' own shifts are
    eliminated.
    """

    def px(length_detector_mm: float) -> float:
        return pixels(length_detector_mm, image.registered.calibration.pixel_mm)

    outline = nail_outline(image.registered, nail, camera_from_nail)
    match = match_nail_outline(image, outline, px(reach_detector_mm))
    if len(match.index) == 0:
        return np.zeros((6, 6)), np.zeros(6), match.found_fraction
    J = np.zeros((len(match.index), 9))
    J[:, :6] = _derivative(image.registered, camera_from_nail, outline, match.index)
    J[:, 6] = 1.0
    J[np.arange(len(match.index)), 7 + outline.side[match.index]] = 1.0
    spacing_px = float(np.median(np.linalg.norm(np.diff(outline.point_px, axis=0), axis=1)))
    crowding = max(px(NAIL_OUTLINE_MATCHING.edge_correlation_detector_mm) / max(spacing_px, 1e-6), 1.0)
    one_edge_px = px(NAIL_OUTLINE_MATCHING.one_edge_sd_detector_mm)
    own_sd_px = np.array([px(NAIL_OUTLINE_MATCHING.both_edges_sd_detector_mm), one_edge_px, one_edge_px])
    robust = robust_weight(match.residual_px, px(NAIL_OUTLINE_MATCHING.robust_detector_mm))
    weight = match.weight * robust / (px(NAIL_OUTLINE_MATCHING.edge_sd_detector_mm) ** 2 * crowding)
    normal = J.T @ (weight[:, None] * J) + np.diag(np.concatenate([np.zeros(6), own_sd_px**-2]))
    gradient = J.T @ (weight * match.residual_px)
    eliminated = np.linalg.solve(normal[6:, 6:], np.column_stack([normal[6:, :6], gradient[6:]]))
    reduced = normal[:6, :6] - normal[:6, 6:] @ eliminated[:, :6]
    reduced_gradient = gradient[:6] - normal[:6, 6:] @ eliminated[:, 6]
    return np.asarray(reduced), np.asarray(reduced_gradient), match.found_fraction


def _derivative(
    registered: RegisteredImage,
    camera_from_nail: Transform[Camera, Nail],
    outline: NailOutline,
    chosen: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Motion of outline points along their normals per small motion of the nail in its own frame, shape (N, 6)."""
    points, outward = outline.point_nail_mm[chosen], outline.outward[chosen]
    stepped = points + _DERIVATIVE_STEP_MM * np.eye(3)[:, None]
    moved_px = registered.calibration.image_from_camera(camera_from_nail.points(stepped)) - outline.point_px[chosen]
    by_axis = np.einsum("kni,ni->nk", moved_px, outward) / _DERIVATIVE_STEP_MM
    # a small rotation w moves a point p by w x p
    return np.hstack([np.cross(points, by_axis), by_axis])
