"""The nail as a band of the image: its two edges, predicted and found, and the guide that places it on a band."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import GUIDE_BALLS_GIVEN_NAIL, GUIDE_ON_NAIL, GUIDE_ON_NAIL_MARGIN
from services.registration.core.guide.locate import GuideFit, Named, guide_identities, measured_guide
from services.registration.core.localise import Parts
from services.registration.core.subpixel import linear_ramp, profile_offsets_px, sample_bilinear, subpixel_peaks
from services.registration.core.tuning import GUIDE_GIVEN_NAIL, NAIL_OUTLINE_MATCHING
from services.registration.core.wires.image import RegisteredImage, balls_mask, shown_pixels, smoothed
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels as pixels_of


@dataclass(frozen=True, slots=True, eq=False)
class NailOutline:
    """Points on the nail's two edges, M in all."""

    # Measured pixels, and unit directions away from the nail, shape (M, 2)
    point_px: NDArray[np.float64]
    outward: NDArray[np.float64]
    point_nail_mm: NDArray[np.float64]  # the same points on the nail, shape (M, 3)
    side: NDArray[np.int64]  # 0 or 1, which edge, shape (M,)


@dataclass(frozen=True, slots=True, eq=False)
class NailOutlineMatch:
    """Edges of the image near points of the nail's outline."""

    index: NDArray[np.int64]  # points of the outline that have an edge, shape (N,)
    weight: NDArray[np.float64]  # above 0 and up to 1, shape (N,)
    residual_px: NDArray[np.float64]  # distance of the edge from the outline, outwards, shape (N,)
    found_fraction: float  # fraction of the visible outline that has an edge, weighted


@dataclass(frozen=True, slots=True, eq=False)
class SmoothImage:
    """A registered image prepared for detecting the nail's edges: smoothed, and 1 where nothing covers it, else 0."""

    registered: RegisteredImage
    smooth: NDArray[np.float32]
    visible: NDArray[np.float32]


def smooth_image(registered: RegisteredImage, guide: GuidePart) -> SmoothImage:
    """Smooth an image and mask balls and border."""
    visible = shown_pixels(registered.calibration) & ~balls_mask(registered, guide)
    smooth = smoothed(registered, NAIL_OUTLINE_MATCHING.blur_detector_mm)
    return SmoothImage(registered, smooth, visible.astype(np.float32))


def nail_outline(registered: RegisteredImage, nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NailOutline:
    """The edges of the nail's round bar about its holes, without its tip."""
    axis_mm = axis_about_holes_mm(nail, NAIL_OUTLINE_MATCHING.proximal_of_holes_mm, NAIL_OUTLINE_MATCHING.step_mm)
    normals = touched_normals(nail, camera_from_nail)[:, None]
    on_nail = axis_mm + nail.radius_mm * normals
    at_px, outside_px = (
        registered.calibration.image_from_camera(camera_from_nail.points(points))
        for points in (on_nail, on_nail + 0.1 * normals)
    )
    way = np.gradient(at_px, axis=1)
    across = np.stack([-way[..., 1], way[..., 0]], axis=-1) / np.linalg.norm(way, axis=-1, keepdims=True)
    outward = across * np.sign(np.sum(across * (outside_px - at_px), axis=-1, keepdims=True))
    side = np.repeat([0, 1], len(axis_mm))
    return NailOutline(at_px.reshape(-1, 2), outward.reshape(-1, 2), on_nail.reshape(-1, 3), side)


def axis_about_holes_mm(nail: NailPart, proximal_of_holes_mm: float, step_mm: float) -> NDArray[np.float64]:
    """Evenly spaced points on the nail's axis, from so far proximal of its holes to where its tip begins, (N, 3)."""
    first_mm = min(float(hole.axis.point_mm[0]) for hole in nail.holes) - proximal_of_holes_mm
    x = np.arange(first_mm, nail.tip_x_mm - nail.radius_mm, step_mm)
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)


def touched_normals(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Normals of the nail's surface where rays touch it on either side, in the nail's frame, shape (2, 3).

    Such a normal n, across the axis, fulfils n . c = -r for c from the focal spot to the axis.
    """
    towards, distance = towards_axis(camera_from_nail)
    sine = nail.radius_mm / distance
    aside = np.sqrt(1.0 - sine**2) * np.cross([1.0, 0.0, 0.0], towards)
    return np.asarray(-sine * towards + np.stack([-aside, aside]))


def towards_axis(camera_from_nail: Transform[Camera, Nail]) -> tuple[NDArray[np.float64], float]:
    """Unit direction across the nail's axis from the focal spot to it, in the nail's frame, and the distance in mm."""
    source = camera_from_nail.inverse().translation_mm
    from_source = np.array([0.0, -source[1], -source[2]])
    distance = float(np.linalg.norm(from_source))
    return from_source / distance, distance


def match_nail_outline(image: SmoothImage, outline: NailOutline, reach_px: float) -> NailOutlineMatch:
    """Steepest brightening outwards within a reach of each point, where both sides are visible.

    Weights fall with the step over the median one (a wire or the guide's body beside the nail makes it smaller), and
    where the edge is partly covered.
    """
    offsets = profile_offsets_px(reach_px)[:, None]
    point, outward = outline.point_px[:, None, :], outline.outward[:, None, :]
    inside, outside = (sample_bilinear(image.smooth, point + (offsets + way) * outward) for way in (-1.0, 1.0))
    peaks = subpixel_peaks(outside - inside, offsets[:, 0])
    edge = outline.point_px + peaks.position[:, None] * outline.outward
    beside_px = pixels_of(NAIL_OUTLINE_MATCHING.beside_detector_mm, image.registered.calibration.pixel_mm)
    beside = [edge + way_px * outline.outward for way_px in (-beside_px, 0.0, beside_px)]
    visible = np.prod([sample_bilinear(image.visible, place) for place in beside], axis=0)
    step = sample_bilinear(image.smooth, beside[2]) - sample_bilinear(image.smooth, beside[0])
    clear = step[visible == 1.0]
    usual = float(np.median(clear)) if clear.size else 0.0
    steep = linear_ramp(step / max(usual, 1e-9), *NAIL_OUTLINE_MATCHING.least_step)
    weight = visible * (peaks.interior & (usual > 0.0)) * steep
    found = np.flatnonzero(weight)
    fraction = float(weight.sum() / max(visible.sum(), 1.0))
    return NailOutlineMatch(found, weight[found], peaks.position[found], fraction)


def locate_guide_given_nail(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> Accepted[GuideFit] | Rejected:
    """Locate the guide in an un-mirrored image, given the nail's pose in the guide frame.

    An oblique image with wires often shows half of the guide, whose balls then fit more than one pose. But the nail is
    the darkest band of the image: only the pose that places the nail on a band of metal is accepted.
    """
    needed = int(GUIDE_BALLS_GIVEN_NAIL.limit.value)
    hypotheses = [one for one in guide_identities(calibration, parts.guide) if len(one) >= needed]
    poses = [one.camera_from_guide @ guide_from_nail for one in hypotheses]
    on_metal = np.array(_fractions_on_metal(pixels, calibration, parts.nail, poses))
    order = np.argsort(-on_metal, kind="stable")
    best, second = [*on_metal[order].tolist(), 0.0, 0.0][:2]
    if not (GUIDE_ON_NAIL.is_met(best) and GUIDE_ON_NAIL_MARGIN.is_met(best - second)):
        observation = (
            f"of {len(hypotheses)} ways to name {needed} balls of the guide or more, with the nail's place known "
            f"from the other image, the best puts {GUIDE_ON_NAIL.quoted(best)} of the nail on metal and the next less "
            f"of it by {GUIDE_ON_NAIL_MARGIN.quoted(best - second)}"
        )
        return Rejected((GUIDE_ON_NAIL.reason(observation),))
    chosen = hypotheses[order[0]]
    others = [len(one) for one in hypotheses if one is not chosen]
    margin = len(chosen) - max(others, default=0)
    return measured_guide(pixels, calibration, parts.ring, parts.guide, Named(chosen, margin, needed))


def _fractions_on_metal(
    pixels: NDArray[np.float32], calibration: CArmCalibration, nail: NailPart, poses: list[Transform[Camera, Nail]]
) -> list[float]:
    """Fraction of the places along the nail, on both sides, that are much darker than what lies beside, by its pose."""
    on_axis = axis_about_holes_mm(nail, NAIL_OUTLINE_MATCHING.proximal_of_holes_mm, GUIDE_GIVEN_NAIL.step_mm)
    inside_mm, outside_mm = (
        radii * nail.radius_mm for radii in (GUIDE_GIVEN_NAIL.inside_radii, GUIDE_GIVEN_NAIL.outside_radii)
    )
    beside_mm = np.array([[-inside_mm, -outside_mm], [inside_mm, outside_mm]])
    shown = shown_pixels(calibration)
    percentiles = [GUIDE_GIVEN_NAIL.dark_percentile, GUIDE_GIVEN_NAIL.light_percentile]
    dark, light = np.percentile(pixels[shown], percentiles) if shown.any() else (0.0, 0.0)

    def fraction(camera_from_nail: Transform[Camera, Nail]) -> float:
        if float(camera_from_nail.translation_mm[2]) <= nail.diameter_mm:
            return 0.0
        ray_nail = camera_from_nail.inverse().directions(unit(camera_from_nail.translation_mm))
        points = on_axis + beside_mm[..., None, None] * unit(np.cross([1.0, 0.0, 0.0], ray_nail))
        nearest_px = np.rint(calibration.image_from_camera(camera_from_nail.points(points))).astype(np.int64)
        last_px = np.array(shown.shape[::-1]) - 1
        column, row = np.moveaxis(np.clip(nearest_px, 0, last_px), -1, 0)
        in_image = ((nearest_px >= 0) & (nearest_px <= last_px)).all(axis=-1)
        visible = (in_image & shown[row, column]).all(axis=1)
        inside, outside = np.moveaxis(pixels[row, column], 1, 0)
        darker = outside - inside > GUIDE_GIVEN_NAIL.least_contrast * (light - dark)
        places = int(np.count_nonzero(visible))
        return np.count_nonzero(visible & darker) / places if places >= GUIDE_GIVEN_NAIL.fewest_places else 0.0

    return [fraction(pose) for pose in poses]
