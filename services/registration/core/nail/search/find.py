"""Find the nail in an image without an initial guess: band, openings, direction, pose at zero tilt.

The result initialises the maximum-likelihood fit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    BAND_WIDTH,
    DIRECTION_CONTRADICTION,
    DIRECTION_MARGIN,
    FAR_END,
    NAIL_BAND,
    SEARCHED_OPENNESS,
    SEARCHED_OUTLINE,
)
from services.registration.core.nail.search.band import SearchImage, depth_range_mm, find_bands, prepare_search
from services.registration.core.nail.search.holes import (
    HolePattern,
    StraightenedBand,
    find_pattern,
    hole_midpoints_mm,
    straighten_band,
)
from services.registration.core.nail.search.outline import Opening, band_width_ideal_px, measure_opening
from services.registration.core.tuning import NAIL_BAND_SEARCH
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart, mean_hole_direction
from shared.geometry.transform import Transform
from shared.two_cores import mapped


@dataclass(frozen=True, slots=True, eq=False)
class NailDetection:
    """The nail detected in an image, with its holes assumed parallel to the rays through them."""

    # Zero tilt: the holes' mean axis runs along the ray through their middle. Depth from the holes' spacing.
    camera_from_nail: Transform[Camera, Nail]
    openings: tuple[Opening, ...]  # one per hole of the nail's file, in its order


def find_nail(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    nail: NailPart,
    distal_hint_camera: NDArray[np.float64] | None = None,
) -> Accepted[NailDetection] | Rejected:
    """Search the whole image for the nail and its holes.

    Parameters
    ----------
    pixels
        Un-mirrored image (see `CArmCalibration.mirrored`), shape (height, width), darker is denser.
    distal_hint_camera
        Rough direction of the nail's +x in the camera frame, shape (3,), for instance the guide's +x. It decides when
        the nail's tip cannot be seen.

    Returns
    -------
    Accepted or Rejected
        Rejected with `nail_not_found`, `hole_not_visible` or `nail_model_mismatch`.
    """
    image = prepare_search(pixels, calibration, nail)
    candidates = mapped(lambda strip: find_pattern(strip, nail), dark_bands(image, calibration, nail), 2)
    if not candidates:
        return _rejected(NAIL_BAND.reason(f"no dark band of a {nail.diameter_mm:g} mm nail's width is in the image"))
    forwards, backwards = max(candidates, key=lambda pair: pattern_quality(pair[0]))
    openness = float(max(forwards.openness.min(), backwards.openness.min()))
    if not SEARCHED_OPENNESS.is_met(openness):
        quoted = SEARCHED_OPENNESS.quoted(max(openness, 0.0))
        return _rejected(
            SEARCHED_OPENNESS.reason(
                f"the nail's band was found, but the contrast of its least visible hole is {quoted} of the band's own"
            )
        )
    pattern = _directed(forwards, backwards, distal_hint_camera)
    if isinstance(pattern, Rejected):
        return pattern
    if (nail.other_holes or len(nail.holes) == 1) and not FAR_END.is_met(pattern.end_evidence):
        return _rejected(_another_hole(nail, pattern))
    return _measured(pixels, image, calibration, nail, pattern)


def _another_hole(nail: NailPart, pattern: HolePattern) -> Reason:
    """A hole looks like another, beside it or in another direction: where the nail ends distinguishes them."""
    sought = " and ".join(f"'{hole.id}'" for hole in nail.holes)
    others = ", ".join(f"'{hole.id}'" for hole in nail.other_holes) or "that the nail's file does not have"
    return FAR_END.reason(
        f"openings were found that could be hole {sought}, but the evidence that the nail ends where it must then end "
        f"is {FAR_END.quoted(pattern.end_evidence)}: they may be other holes ({others})"
    )


def dark_bands(image: SearchImage, calibration: CArmCalibration, nail: NailPart) -> list[StraightenedBand]:
    """Straightened bands of the nail's width that are darker than their sides."""
    near_mm, far_mm = depth_range_mm(calibration)
    width_at_1_mm = nail.diameter_mm * calibration.camera.focal_length_px / image.step_px
    widths_px = (width_at_1_mm / far_mm, width_at_1_mm / near_mm)
    bands = find_bands(image, widths_px, NAIL_BAND_SEARCH.most_bands)
    strips = [straighten_band(image, band) for band in bands]
    return [strip for strip in strips if strip.clear_darkness >= NAIL_BAND_SEARCH.least_darkness]


def pattern_quality(pattern: HolePattern) -> float:
    """Rank of a band: how open its holes are, then how long its edges are."""
    openness = float(np.clip(pattern.openness.min(), 0.0, 1.0))
    band = pattern.strip.band
    return openness + NAIL_BAND_SEARCH.edge_length_weight * band.edge_length_px / max(band.width_px, 1.0)


def _directed(
    forwards: HolePattern, backwards: HolePattern, hint_camera: NDArray[np.float64] | None
) -> HolePattern | Rejected:
    """Choose the direction of the nail: from its tip and the pattern of its holes, else from the hint."""
    evidence = [p.tip_evidence + float(np.minimum(p.openness, 1.0).min()) for p in (forwards, backwards)]
    seen, margin = (forwards, evidence[0] - evidence[1])
    if margin < 0.0:
        seen, margin = backwards, -margin
    if hint_camera is None:
        if not DIRECTION_MARGIN.is_met(margin):
            quoted = DIRECTION_MARGIN.quoted(margin)
            return _rejected(DIRECTION_MARGIN.reason(f"the nail was found, but not its distal end: margin {quoted}"))
        return seen
    along = forwards.strip.band.along
    hinted = forwards if float(along @ hint_camera[:2]) >= 0.0 else backwards
    if hinted is seen:
        return seen
    if not DIRECTION_CONTRADICTION.is_met(margin):
        quoted = DIRECTION_CONTRADICTION.quoted(margin)
        return _rejected(
            DIRECTION_CONTRADICTION.reason(f"the nail's tip lies opposite to the guide's distal end: margin {quoted}")
        )
    return hinted


def _measured(
    pixels: NDArray[np.generic],
    image: SearchImage,
    calibration: CArmCalibration,
    nail: NailPart,
    pattern: HolePattern,
) -> Accepted[NailDetection] | Rejected:
    """Measure the openings and the band's width, and build the pose."""
    openings = _openings(pixels, image, calibration, nail, pattern)
    if isinstance(openings, Rejected):
        return openings
    width_px = band_width_ideal_px(image, pattern)
    focal_px = calibration.camera.focal_length_px
    rays = calibration.camera.rays(np.array([o.ellipse.centre_px for o in openings]))
    distal = np.array([*(pattern.distal_sign * pattern.strip.band.along), 0.0])
    pose = camera_from_nail_facing(nail, rays, unit(rays.sum(axis=0)), distal, nail.diameter_mm * focal_px / width_px)
    expected_px = nail.diameter_mm * focal_px / float(pose.translation_mm[2])
    ratio = width_px / expected_px
    if not BAND_WIDTH.is_met(abs(ratio - 1.0)):
        quoted = BAND_WIDTH.quoted(ratio - 1.0, sign="+")
        return _rejected(
            BAND_WIDTH.reason(
                f"the band's width differs by {quoted} from that of a {nail.diameter_mm:g} mm nail with these holes"
            )
        )
    return Accepted(NailDetection(pose, openings))


def _openings(
    pixels: NDArray[np.generic],
    image: SearchImage,
    calibration: CArmCalibration,
    nail: NailPart,
    pattern: HolePattern,
) -> tuple[Opening, ...] | Rejected:
    proposed_px = calibration.distortion.distort(image.ideal_px(pattern.centre_search_px))
    found = []
    for hole, centre_px in zip(nail.holes, proposed_px, strict=True):
        px_per_mm = pattern.px_per_mm * image.step_px
        half_slot_px = hole.half_slot_mm * px_per_mm * pattern.strip.band.along
        opening = measure_opening(
            pixels, calibration, hole.id, centre_px, 0.5 * hole.diameter_mm * px_per_mm, half_slot_px
        )
        seen = 0.0 if opening is None else opening.seen_fraction
        if opening is None or not SEARCHED_OUTLINE.is_met(seen):
            quoted = SEARCHED_OUTLINE.quoted(seen)
            return _rejected(
                SEARCHED_OUTLINE.reason(f"the outline of nail hole '{hole.id}' is visible over {quoted} of its length")
            )
        found.append(opening)
    return tuple(found)


def _rejected(reason: Reason) -> Rejected:
    return Rejected((reason,))


def camera_from_nail_facing(
    nail: NailPart,
    hole_rays_camera: NDArray[np.float64],
    hole_axis_camera: NDArray[np.float64],
    distal_camera: NDArray[np.float64],
    depth_from_width_mm: float,
) -> Transform[Camera, Nail]:
    """Pose with the holes' mean axis along a given direction that puts every hole on its ray.

    With the axis given, a rotation about it, a shift across it and a depth remain: they follow from a linear fit of the
    holes' places to the rays (in complex numbers: rotation and scale are one factor).

    Parameters
    ----------
    hole_rays_camera
        Unit direction of the ray through each opening's centre, in the order of the nail's holes, shape (N, 3).
    hole_axis_camera
        Direction that the holes' mean axis is to have, unit, shape (3,).
    distal_camera
        Rough direction of the nail's +x, shape (3,). Used alone when there is only one hole.
    depth_from_width_mm
        Depth to use when there is only one hole.

    Returns
    -------
    Transform
        `camera_from_nail`. Several holes give the depth; a tilt of 10 degrees about the band's normal makes it 1.5 %
        too large.
    """
    view = _frame_about(hole_axis_camera, distal_camera)
    flat = _frame_about(mean_hole_direction(nail), np.array([1.0, 0.0, 0.0]))
    holes = hole_midpoints_mm(nail) @ flat.T
    rays = hole_rays_camera @ view.T
    # A point at (x, y, z + depth) appears at (x, y) / (depth + z); z varies by millimetres against 700 mm of depth.
    seen = (rays[:, 0] + 1j * rays[:, 1]) / rays[:, 2]
    known = holes[:, 0] + 1j * holes[:, 1]
    if len(known) == 1:
        factor, shift = 1.0 / depth_from_width_mm + 0j, seen[0] - known[0] / depth_from_width_mm
    else:
        design = np.stack([known, np.ones_like(known)], axis=-1)
        (factor, shift), *_ = np.linalg.lstsq(design, seen, rcond=None)
    depth_mm = 1.0 / abs(factor)
    spin = factor * depth_mm
    turn = np.array([[spin.real, -spin.imag, 0.0], [spin.imag, spin.real, 0.0], [0.0, 0.0, 1.0]])
    rotation = view.T @ turn @ flat
    origin = view.T @ np.array([shift.real * depth_mm, shift.imag * depth_mm, depth_mm - float(holes[:, 2].mean())])
    return Transform.from_rotation_translation(rotation, origin)


def _frame_about(z_axis: NDArray[np.float64], near_x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation, shape (3, 3), whose rows are a right-handed frame with the given z, and x near the given direction."""
    z = unit(z_axis)
    x = unit(near_x - z * (near_x @ z))
    return np.stack([x, np.cross(z, x), z])
