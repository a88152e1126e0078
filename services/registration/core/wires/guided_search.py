"""Searches that use what is known: the nail's holes near the guide's axes, and the guide given the nail's pose in it.

A wire in an opening makes it dim, and the whole image has brighter places than that: the guide's own bores beside the
nail. But wires go through the guide's holes towards the nail's, so that those cannot be far from the guide's axes.

An oblique image with wires often shows half of the guide. Its balls then fit more than one pose; but another image of
the same case gives the nail's pose in the guide frame, and the nail is the darkest band of the image. Only the pose of
the guide that places the nail on a band of metal is accepted.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import (
    GUIDE_BALLS_GIVEN_NAIL,
    GUIDE_ON_NAIL,
    GUIDE_ON_NAIL_MARGIN,
    OPENNESS_BESIDE_WIRES,
    SEARCHED_OUTLINE,
)
from services.registration.core.guide.locate import GuideFit, Named, guide_identities, measured_guide
from services.registration.core.localise import Parts
from services.registration.core.nail.search.band import SearchImage, depth_range_mm, find_bands, prepare_search
from services.registration.core.nail.search.find import camera_from_nail_facing
from services.registration.core.nail.search.holes import HolePattern, StraightenedBand, find_pattern, straighten_band
from services.registration.core.nail.search.outline import measure_opening
from services.registration.core.tuning import (
    GUIDE_GIVEN_NAIL,
    NAIL_BAND_SEARCH,
    NAIL_OUTLINE_MATCHING,
    NAIL_WITH_WIRES,
)
from services.registration.core.wires.image import RegisteredImage, shown_pixels
from services.registration.core.wires.nail_outline import axis_about_holes_mm
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform


def locate_nail_near_guide_axes(
    registered: RegisteredImage, guide: GuidePart, nail: NailPart
) -> Accepted[Transform[Camera, Nail]] | Rejected:
    """Start of a fit: the nail's pose to a few pixels and degrees, with its holes along the guide's."""
    calibration, camera_from_guide = registered.calibration, registered.camera_from_guide
    image = prepare_search(registered.pixels, calibration, nail)
    patterns = list(_patterns(image, calibration, guide, nail, camera_from_guide))
    best = max(patterns, key=_quality, default=None)
    openness = 0.0 if best is None else float(best.openness.min())
    if best is None or not OPENNESS_BESIDE_WIRES.is_met(openness):
        observation = (
            f"within {NAIL_WITH_WIRES.reach_from_axes_mm:.0f} mm of where the guide's holes point, the contrast of the "
            f"nail's least visible hole is {OPENNESS_BESIDE_WIRES.quoted(max(openness, 0.0))} of the nail's own"
        )
        return Rejected((OPENNESS_BESIDE_WIRES.reason(observation),))
    centres_px = [
        _centre_ideal_px(registered, image, best, place, 0.5 * hole.diameter_mm)
        for place, hole in zip(best.centre_search_px, nail.holes, strict=True)
    ]
    depth_mm = calibration.camera.focal_length_px / (best.px_per_mm * image.step_px)
    rays = calibration.camera.rays(np.array(centres_px))
    drilling = unit(np.sum([hole.axis.direction for hole in guide.holes], axis=0))
    drilling_camera, distal_camera = camera_from_guide.directions(np.stack([drilling, [1.0, 0.0, 0.0]]))
    return Accepted(camera_from_nail_facing(nail, rays, drilling_camera, distal_camera, depth_mm))


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
    widths_px = (width_at_1_mm / far_mm, width_at_1_mm / near_mm)
    for band in find_bands(image, widths_px, NAIL_BAND_SEARCH.most_bands):
        strip = straighten_band(image, band)
        if strip.typical_darkness < NAIL_BAND_SEARCH.least_darkness:
            continue
        px_per_mm = band.width_px / nail.diameter_mm
        depth_mm = calibration.camera.focal_length_px / (px_per_mm * image.step_px)
        places_px = _axes_at_depth_px(calibration, guide, camera_from_guide, depth_mm) / image.step_px
        valid = strip.valid & _near(strip, places_px, NAIL_WITH_WIRES.reach_from_axes_mm * px_per_mm)
        if not valid.any():
            continue
        forwards, backwards = find_pattern(replace(strip, valid=valid), nail)
        yield forwards if float(band.along @ distal[:2]) >= 0.0 else backwards


def _axes_at_depth_px(
    calibration: CArmCalibration, guide: GuidePart, camera_from_guide: Transform[Camera, Guide], depth_mm: float
) -> NDArray[np.float64]:
    """Ideal pixels where the guide's axes reach a depth, shape (H, 2)."""
    points = camera_from_guide.points(np.array([hole.axis.point_mm for hole in guide.holes]))
    along = camera_from_guide.directions(np.array([hole.axis.direction for hole in guide.holes]))
    at_depth = points + along * ((depth_mm - points[:, 2]) / along[:, 2])[:, None]
    return np.asarray(calibration.camera.project(at_depth))


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
    band = pattern.strip.band
    return openness + NAIL_BAND_SEARCH.edge_length_weight * band.edge_length_px / max(band.width_px, 1.0)


def _centre_ideal_px(
    registered: RegisteredImage,
    image: SearchImage,
    pattern: HolePattern,
    place_search_px: NDArray[np.float64],
    radius_mm: float,
) -> NDArray[np.float64]:
    """Centre of an opening's outline where enough of it is visible beside the wire, else that of the pattern."""
    calibration = registered.calibration
    ideal = image.ideal_px(place_search_px)
    radius_px = radius_mm * pattern.px_per_mm * image.step_px
    opening = measure_opening(registered.pixels, calibration, "", calibration.distortion.distort(ideal), radius_px)
    if opening is None or not SEARCHED_OUTLINE.is_met(opening.seen_fraction):
        return ideal
    return opening.ellipse.centre_px


def locate_guide_given_nail(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> Accepted[GuideFit] | Rejected:
    """Locate the guide in an un-mirrored image, given the nail's pose in the guide frame."""
    needed = int(GUIDE_BALLS_GIVEN_NAIL.limit.value)
    hypotheses = [one for one in guide_identities(calibration, parts.guide) if len(one) >= needed]
    on_metal = np.array(
        [
            _fraction_on_metal(pixels, calibration, parts.nail, one.camera_from_guide @ guide_from_nail)
            for one in hypotheses
        ]
    )
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


def _fraction_on_metal(
    pixels: NDArray[np.float32], calibration: CArmCalibration, nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> float:
    """Fraction of the places along the nail, on both sides, that are much darker than what lies beside."""
    if float(camera_from_nail.translation_mm[2]) <= nail.diameter_mm:
        return 0.0
    on_axis = axis_about_holes_mm(nail, NAIL_OUTLINE_MATCHING.proximal_of_holes_mm, GUIDE_GIVEN_NAIL.step_mm)
    ray_nail = camera_from_nail.inverse().directions(unit(camera_from_nail.translation_mm))
    aside = unit(np.cross([1.0, 0.0, 0.0], ray_nail))
    shown = shown_pixels(calibration)
    percentiles = [GUIDE_GIVEN_NAIL.dark_percentile, GUIDE_GIVEN_NAIL.light_percentile]
    dark, light = np.percentile(pixels[shown], percentiles) if shown.any() else (0.0, 0.0)
    hits, places = 0, 0
    for side in (-1.0, 1.0):
        greys = []
        visible = np.ones(len(on_axis), dtype=np.bool_)
        for radii in (GUIDE_GIVEN_NAIL.inside_radii, GUIDE_GIVEN_NAIL.outside_radii):
            points = on_axis + side * radii * nail.radius_mm * aside
            column, row = np.rint(calibration.image_from_camera(camera_from_nail @ points)).astype(np.int64).T
            inside = (column >= 0) & (column < shown.shape[1]) & (row >= 0) & (row < shown.shape[0])
            row, column = np.clip(row, 0, shown.shape[0] - 1), np.clip(column, 0, shown.shape[1] - 1)
            visible &= inside & shown[row, column]
            greys.append(pixels[row, column])
        darker = greys[1] - greys[0] > GUIDE_GIVEN_NAIL.least_contrast * (light - dark)
        hits += int(np.count_nonzero(visible & darker))
        places += int(np.count_nonzero(visible))
    return hits / places if places >= GUIDE_GIVEN_NAIL.fewest_places else 0.0
