"""Outline of a K-wire in an image, its match to the image's edges, and the axes from which a fit starts.

A wire is a row of cross-sections along its axis, which appear as discs. Its outline is the envelope of the discs: two
sides, and a cap at either end; of a wire seen nearly end on, only one cap.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.subpixel import linear_ramp, profile_offsets_px, sample_bilinear, subpixel_peaks
from services.registration.core.tuning import WIRE_OUTLINE, WIRE_STARTS
from services.registration.core.wires.image import GradientImage
from services.registration.core.wires.model import WIRE_UNKNOWNS, WireModel

# Unknowns of an image: the error of the wire's apparent radius, then six of the guide's pose.
IMAGE_UNKNOWNS = 7


@dataclass(frozen=True, slots=True, eq=False)
class CrossSections:
    """Discs along a wire in one image."""

    centre_px: NDArray[np.float64]  # measured pixels, shape (K, 2)
    radius_px: NDArray[np.float64]  # shape (K,)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points on a wire's outline."""

    section: NDArray[np.int64]  # index of the cross-section that each point lies on, shape (M,)
    outward: NDArray[np.float64]  # unit direction away from the wire, shape (M, 2)
    point_px: NDArray[np.float64]  # shape (M, 2)
    length_px: NDArray[np.float64]  # length of outline that each point represents, shape (M,)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedWire:
    """A wire's cross-sections and outline in one image."""

    sections: CrossSections
    outline: Outline
    visible_px: NDArray[np.float64]  # visible length of outline that each point represents, shape (M,)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeMatches:
    """Edges of the image near points of an outline."""

    index: NDArray[np.int64]  # points of the outline that have one, shape (N,)
    # Above 0 and up to 1; a hard decision would make the wire's likelihood discontinuous, shape (N,)
    weight: NDArray[np.float64]
    residual_px: NDArray[np.float64]  # distance of the edge from the outline, outwards, shape (N,)
    # Of the wire just inside, between the nail's metal (1) and what lies just outside (0), shape (N,)
    darkness: NDArray[np.float64]


def outline_of(sections: CrossSections) -> Outline:
    """Envelope of a row of discs: where neighbouring discs touch it, and both caps."""
    step = np.gradient(sections.centre_px, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)  # no division by zero for a wire seen end on
    along = step / length[:, None]
    # The envelope's normal leans forward by as much as the discs shrink per pixel along the wire.
    lean = -np.gradient(sections.radius_px) / length
    has_sides = np.flatnonzero(np.abs(lean) < 1.0)[1:-1]
    upright = np.sqrt(np.maximum(1.0 - lean[has_sides] ** 2, 0.0))[:, None]
    t, n = along[has_sides], np.stack([-along[has_sides, 1], along[has_sides, 0]], axis=-1)
    forward = lean[has_sides][:, None] * t
    sides = [forward + upright * n, forward - upright * n]
    (first, first_rad), (last, last_rad) = _cap(-along[0], -lean[0]), _cap(along[-1], lean[-1])
    end = len(length) - 1
    section = np.concatenate([has_sides, has_sides, np.repeat([0, end], WIRE_OUTLINE.cap_points)])
    outward = np.concatenate([*sides, first, last])
    points = sections.centre_px[section] + sections.radius_px[section][:, None] * outward
    cap_px = [sections.radius_px[0] * first_rad, sections.radius_px[end] * last_rad]
    # of the tangent to two neighbouring discs, between the points where it touches them
    side_px = length[has_sides] * upright[:, 0]
    length_px = np.concatenate([side_px, side_px, np.repeat(cap_px, WIRE_OUTLINE.cap_points)])
    return Outline(section.astype(np.int64), outward, points, length_px)


def _cap(towards_end: NDArray[np.float64], lean: float) -> tuple[NDArray[np.float64], float]:
    """Directions, shape (C, 2), in which a disc at an end of the wire is the outline, and the angle between them.

    Their number is constant, so that nothing jumps when the wire turns: seen end on, they are all around one disc, and
    nowhere around the other.
    """
    count = WIRE_OUTLINE.cap_points
    half_rad = float(np.arccos(np.clip(lean, -1.0, 1.0)))
    angle = half_rad * ((2.0 * np.arange(count) + 1.0) / count - 1.0)
    beside = np.array([-towards_end[1], towards_end[0]])
    return np.cos(angle)[:, None] * towards_end + np.sin(angle)[:, None] * beside, 2.0 * half_rad / count


def match_edges(image: GradientImage, wire: ProjectedWire, reach_px: float) -> EdgeMatches:
    """Steepest brightening outwards within a reach of each outline point, where a wire would be visible.

    Weights fall where the slope hardly exceeds that of the image's texture and where the wire is bright inside: steel
    is dark, bone is not.
    """
    outline = wire.outline
    offsets = profile_offsets_px(reach_px)
    where = outline.point_px[:, None, :] + offsets[None, :, None] * outline.outward[:, None, :]
    along_x, along_y = (sample_bilinear(slope, where) for slope in (image.slope_x, image.slope_y))
    slope = along_x * outline.outward[:, None, 0] + along_y * outline.outward[:, None, 1]
    slope = np.where(sample_bilinear(image.visible, where) > 0.0, slope, 0.0)
    peaks = subpixel_peaks(slope, offsets)
    edge = outline.point_px + peaks.position[:, None] * outline.outward
    weight = linear_ramp(peaks.height / image.noise, *WIRE_OUTLINE.least_strength) * peaks.interior
    clearance_px = image.length_px(WIRE_OUTLINE.mask_clearance_detector_mm)
    for sense in (-1.0, 1.0):
        weight *= sample_bilinear(image.visible, edge + sense * clearance_px * outline.outward)
    radius = wire.sections.radius_px[outline.section][:, None]
    inside = sample_bilinear(image.smooth, edge - WIRE_OUTLINE.inside_radii * radius * outline.outward)
    outside = sample_bilinear(image.smooth, edge + WIRE_OUTLINE.outside_radii * radius * outline.outward)
    darkness = (outside - inside) / np.maximum(outside - image.metal_grey, 1e-9)
    weight *= linear_ramp(darkness, *WIRE_OUTLINE.least_darkness)
    found = np.flatnonzero(weight)
    return EdgeMatches(found, weight[found], peaks.position[found], darkness[found])


def cross_sections(image: GradientImage, model: WireModel, unknowns: NDArray[np.float64], count: int) -> CrossSections:
    """Cross-sections of wires: centres of shape (B, count, 2), radii of shape (B, count).

    The unknowns, shape (B, 13), are those of the wire (see `WireModel`), then of the image: the error of the apparent
    radius (px), then that of the guide's pose (rad, mm, in the guide's own frame).
    """
    points = model.points_guide_mm(unknowns[:, :WIRE_UNKNOWNS], count)
    turn, shift = unknowns[:, None, WIRE_UNKNOWNS + 1 : WIRE_UNKNOWNS + 4], unknowns[:, None, WIRE_UNKNOWNS + 4 :]
    # The guide's pose is wrong by a hundredth of a degree: the rotation's first order is exact to nanometres.
    points_camera = image.registered.camera_from_guide.points(points + np.cross(turn, points) + shift)
    calibration = image.registered.calibration
    distance = np.linalg.norm(points_camera, axis=-1)
    radius = model.radius_mm * calibration.camera.focal_length_px / distance + unknowns[:, WIRE_UNKNOWNS, None]
    return CrossSections(calibration.image_from_camera(points_camera), radius)


def project_wire(image: GradientImage, model: WireModel, unknowns: NDArray[np.float64]) -> ProjectedWire:
    """One wire in one image, unknowns of shape (13,), with evenly spaced cross-sections."""
    rough = cross_sections(image, model, unknowns[None], 3).centre_px[0]
    length_px = float(np.linalg.norm(np.diff(rough, axis=0), axis=1).sum())
    spacing_px = image.length_px(WIRE_OUTLINE.section_spacing_detector_mm)
    count = int(np.clip(length_px / spacing_px, WIRE_OUTLINE.fewest_sections, WIRE_OUTLINE.most_sections))
    sections = cross_sections(image, model, unknowns[None], count)
    return outlined(image, CrossSections(sections.centre_px[0], sections.radius_px[0]))


def outlined(image: GradientImage, sections: CrossSections) -> ProjectedWire:
    """Cross-sections with their outline and its visibility."""
    outline = outline_of(sections)
    # The cap at the start of the wire does not count: its place is unknown.
    visible = sample_bilinear(image.visible, outline.point_px) * (outline.section > 0)
    return ProjectedWire(sections, outline, outline.length_px * visible)


def starting_wires(images: tuple[GradientImage, ...], model: WireModel) -> list[NDArray[np.float64]]:
    """Unknowns of the best wires on a grid, apart from one another, shape (6,) each.

    The axes pass through the middle of the guide hole; they are ranked by the length of outline that lies on edges.
    """
    steps = np.arange(-WIRE_STARTS.reach_mm, WIRE_STARTS.reach_mm + 1e-9, WIRE_STARTS.step_mm)
    scored = _ranked(images, model, [(x, y, 0.0) for x in steps for y in steps])[: WIRE_STARTS.candidates]
    others = [(x, y, tip) for _, (x, y, _) in scored for tip in WIRE_STARTS.other_tips_mm]
    chosen: list[tuple[float, float, float]] = []
    for _, place in sorted(scored + _ranked(images, model, others), reverse=True):
        if all(np.hypot(place[0] - x, place[1] - y) > WIRE_STARTS.apart_mm for x, y, _ in chosen):
            chosen.append(place)
    return [_unknowns_at(model, place) for place in chosen[: WIRE_STARTS.starts]]


def _ranked(
    images: tuple[GradientImage, ...], model: WireModel, places: list[tuple[float, float, float]]
) -> list[tuple[float, tuple[float, float, float]]]:
    """Scores of places at the nail (two offsets, and the tip's distance past its mean, in mm), best first."""
    unknowns = np.array([_unknowns_at(model, place) for place in places])
    deviation = unknowns - model.mean
    scores = -0.5 * np.einsum("bi,ij,bj->b", deviation, model.precision, deviation)
    in_image = np.concatenate([unknowns, np.zeros((len(places), IMAGE_UNKNOWNS))], axis=1)
    for image in images:
        sections = cross_sections(image, model, in_image, WIRE_STARTS.sections)
        pairs = zip(sections.centre_px, sections.radius_px, strict=True)
        scores += [_evidence_px(image, CrossSections(centre_px, radius_px)) for centre_px, radius_px in pairs]
    return sorted(zip(scores.tolist(), places, strict=True), reverse=True)


def _unknowns_at(model: WireModel, place: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(model.mean + np.array([0.0, 0.0, place[0], place[1], 0.0, place[2]]))


def _evidence_px(image: GradientImage, sections: CrossSections) -> float:
    wire = outlined(image, sections)
    matches = match_edges(image, wire, image.length_px(WIRE_STARTS.reach_detector_mm))
    found_px = float(matches.weight @ wire.visible_px[matches.index])
    return found_px - WIRE_STARTS.missing_penalty * float(wire.visible_px.sum())
