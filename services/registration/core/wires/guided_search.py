"""Where the nail lies, roughly, in an image with wires: searched for where the guide's holes point.

A wire in an opening makes it dim, and the whole image has brighter places than that: the guide's own bores beside the
nail. But wires go through the guide's holes towards the nail's, so that those cannot be far from the guide's axes.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.search import SEARCHED_OUTLINE
from services.registration.core.acceptance.wires import GUIDE_ON_NAIL, GUIDE_ON_NAIL_MARGIN, OPENNESS_BESIDE_WIRES
from services.registration.core.guide.locate import GuideFit, Named, guide_identities, measured_guide
from services.registration.core.localise import Parts
from services.registration.core.nail.search.band import SearchImage, depth_range_mm, find_bands, prepare_search
from services.registration.core.nail.search.find import camera_from_nail_facing
from services.registration.core.nail.search.holes import HolePattern, StraightenedBand, find_pattern, straighten_band
from services.registration.core.nail.search.outline import measure_opening
from services.registration.core.wires.image import in_border
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform

# How far from the guide's axes, across them, the nail's holes are looked for.
LARGEST_MISALIGNMENT_MM = 18.0
_BANDS_TRIED = 6
_LOWEST_DARKNESS = 0.06


def nail_beside_guide(
    upright: NDArray[np.float32],
    calibration: CArmCalibration,
    guide: GuidePart,
    nail: NailPart,
    camera_from_guide: Transform[Camera, Guide],
) -> Accepted[Transform[Camera, Nail]] | Rejected:
    """Start of a fit: the nail's pose, a few pixels and degrees off, with its holes along the guide's.

    Parameters
    ----------
    upright
        Un-mirrored image, shape (height, width), darker is denser.
    """
    image = prepare_search(upright, calibration, nail)
    drilling = unit(np.sum([hole.axis.direction for hole in guide.holes], axis=0))
    along_camera = camera_from_guide.directions(drilling)
    patterns = list(_patterns(image, calibration, guide, nail, camera_from_guide))
    best = max(patterns, key=_quality, default=None)
    openness = 0.0 if best is None else float(best.openness.min())
    if best is None or not OPENNESS_BESIDE_WIRES.is_met(openness):
        observation = (
            f"within {LARGEST_MISALIGNMENT_MM:.0f} mm of where the guide's holes point, the contrast of the nail's "
            f"least visible hole is {OPENNESS_BESIDE_WIRES.quoted(max(openness, 0.0))} of the nail's own"
        )
        return Rejected((OPENNESS_BESIDE_WIRES.reason(observation),))
    centres_px = [
        _centre_ideal_px(upright, image, calibration, best, place, 0.5 * hole.diameter_mm)
        for place, hole in zip(best.centre_search_px, nail.holes, strict=True)
    ]
    depth_mm = calibration.camera.focal_length_px / (best.px_per_mm * image.step_px)
    rays = calibration.camera.rays(np.array(centres_px))
    distal = camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))
    return Accepted(camera_from_nail_facing(nail, rays, along_camera, distal, depth_mm))


def _patterns(
    image: SearchImage,
    calibration: CArmCalibration,
    guide: GuidePart,
    nail: NailPart,
    camera_from_guide: Transform[Camera, Guide],
) -> Iterator[HolePattern]:
    """The holes along each band of the nail's width, in the guide's sense, where the guide's axes meet the band."""
    near_mm, far_mm = depth_range_mm(calibration)
    width_at_1_mm = nail.diameter_mm * calibration.camera.focal_length_px / image.step_px
    distal = camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))
    for band in find_bands(image, (width_at_1_mm / far_mm, width_at_1_mm / near_mm), _BANDS_TRIED):
        strip = straighten_band(image, band)
        if strip.typical_darkness < _LOWEST_DARKNESS:
            continue
        px_per_mm = band.width_px / nail.diameter_mm
        depth_mm = calibration.camera.focal_length_px / (px_per_mm * image.step_px)
        places_px = _aimed_at_px(calibration, guide, camera_from_guide, depth_mm) / image.step_px
        valid = strip.valid & _near(strip, places_px, LARGEST_MISALIGNMENT_MM * px_per_mm)
        if not valid.any():
            continue
        forwards, backwards = find_pattern(replace(strip, valid=valid), nail)
        yield forwards if float(band.along @ distal[:2]) >= 0.0 else backwards


def _aimed_at_px(
    calibration: CArmCalibration, guide: GuidePart, camera_from_guide: Transform[Camera, Guide], depth_mm: float
) -> NDArray[np.float64]:
    """Ideal pixels where the guide's axes reach a depth, shape (H, 2)."""
    plane_point, plane_normal = np.array([0.0, 0.0, depth_mm]), np.array([0.0, 0.0, 1.0])
    axes = [(camera_from_guide @ hole.axis.point_mm, hole.axis.direction) for hole in guide.holes]
    points = []
    for point, direction in axes:
        along = camera_from_guide.directions(direction)
        points.append(point + along * ((plane_point - point) @ plane_normal) / (along @ plane_normal))
    return np.asarray(calibration.camera.project(np.array(points)))


def _near(strip: StraightenedBand, places_px: NDArray[np.float64], reach_px: float) -> NDArray[np.bool_]:
    """Columns of a strip within reach of one of some places of the search image; none when all lie beside the band."""
    band = strip.band
    column = (places_px - band.centre_px) @ band.along - strip.first_along_px
    aside = np.abs((places_px - band.centre_px) @ band.across)
    apart = np.abs(np.arange(strip.valid.size)[:, None] - column)
    return np.asarray(((apart < reach_px) & (aside < reach_px)).any(axis=1))


def _quality(pattern: HolePattern) -> float:
    """Rank of a band: how open its holes are, then how long its edges are."""
    openness = float(np.clip(pattern.openness.min(), 0.0, 1.0))
    return openness + 0.2 * pattern.strip.band.edge_length_px / max(pattern.strip.band.width_px, 1.0)


def _centre_ideal_px(
    upright: NDArray[np.float32],
    image: SearchImage,
    calibration: CArmCalibration,
    pattern: HolePattern,
    place_search_px: NDArray[np.float64],
    radius_mm: float,
) -> NDArray[np.float64]:
    """Centre of an opening's outline where that can be seen beside the wire, else where the pattern has it."""
    ideal = image.ideal_px(place_search_px)
    radius_px = radius_mm * pattern.px_per_mm * image.step_px
    opening = measure_opening(upright, calibration, "", calibration.distortion.distort(ideal), radius_px)
    if opening is None or not SEARCHED_OUTLINE.is_met(opening.seen_fraction):
        return ideal
    return opening.ellipse.centre_px


LEAST_BALLS = 7
_PROXIMAL_OF_HOLES_MM, _STEP_MM = 30.0, 1.0
_INSIDE, _OUTSIDE = 0.6, 1.6
_LEAST_CONTRAST = 0.25
_LEAST_POINTS = 20


def locate_guide_beside(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> Accepted[GuideFit] | Rejected:
    """Find the guide in an un-mirrored image, given where the nail lies from it."""
    named = [one for one in guide_identities(calibration, parts.guide) if len(one) >= LEAST_BALLS]
    bands = np.array([_band(pixels, calibration, parts.nail, one.camera_from_guide @ guide_from_nail) for one in named])
    order = np.argsort(-bands, kind="stable")
    best = float(bands[order[0]]) if len(order) else 0.0
    second = float(bands[order[1]]) if len(order) > 1 else 0.0
    if not (GUIDE_ON_NAIL.is_met(best) and GUIDE_ON_NAIL_MARGIN.is_met(best - second)):
        observation = (
            f"of {len(named)} ways to name {LEAST_BALLS} balls of the guide or more, with the nail's place known from "
            f"the other image, the best puts {GUIDE_ON_NAIL.quoted(best)} of the nail on metal and the next less of it "
            f"by {GUIDE_ON_NAIL_MARGIN.quoted(best - second)}"
        )
        return Rejected((GUIDE_ON_NAIL.reason(observation),))
    chosen = named[order[0]]
    others = [len(one) for one in named if one is not chosen]
    margin = len(chosen) - max(others, default=0)
    return measured_guide(pixels, calibration, parts.ring, parts.guide, Named(chosen, margin, LEAST_BALLS))


def _band(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    nail: NailPart,
    camera_from_nail: Transform[Camera, Nail],
) -> float:
    """Share of the places along the nail, on both sides, that are much darker than what lies beside."""
    if float(camera_from_nail.translation_mm[2]) <= nail.diameter_mm:
        return 0.0
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    x = np.arange(min(along) - _PROXIMAL_OF_HOLES_MM, nail.tip_x_mm - nail.radius_mm, _STEP_MM)
    ray_nail = camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm)
    aside = unit(np.cross([1.0, 0.0, 0.0], ray_nail))
    usable = in_border(calibration)
    dark, light = np.percentile(pixels[usable], [2.0, 90.0]) if usable.any() else (0.0, 0.0)
    on_axis = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    hits, seen = 0, 0
    for side in (-1.0, 1.0):
        greys = []
        visible = np.ones(len(x), dtype=np.bool_)
        for share in (_INSIDE, _OUTSIDE):
            points = on_axis + side * share * nail.radius_mm * aside
            column, row = np.rint(calibration.image_from_camera(camera_from_nail @ points)).astype(np.int64).T
            inside = (column >= 0) & (column < usable.shape[1]) & (row >= 0) & (row < usable.shape[0])
            row, column = np.clip(row, 0, usable.shape[0] - 1), np.clip(column, 0, usable.shape[1] - 1)
            visible &= inside & usable[row, column]
            greys.append(pixels[row, column])
        hits += int(np.count_nonzero(visible & (greys[1] - greys[0] > _LEAST_CONTRAST * (light - dark))))
        seen += int(np.count_nonzero(visible))
    return hits / seen if seen >= _LEAST_POINTS else 0.0
