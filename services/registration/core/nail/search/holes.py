"""Find the bright openings of the nail's holes inside its dark band, and which end of the band is distal."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.search.band import Band, SearchImage
from services.registration.core.tuning import NAIL_HOLE_SEARCH
from shared.geometry.parts import NailPart, hole_surface_points

# Openness of columns that cannot be a hole's middle.
_NOT_A_HOLE = -1.0


@dataclass(frozen=True, slots=True, eq=False)
class StraightenedBand:
    """The image along a band, turned upright: columns along it, rows across it, 1 pixel of the search image each."""

    band: Band
    grey: NDArray[np.float32]  # shape (rows, columns), float32; the middle row is the band's middle line
    valid: NDArray[np.bool_]  # shape (columns,): the middle line is inside the image
    first_along_px: float  # place of column 0 along the band, from the band's centre
    darkness: NDArray[np.float64]  # how much darker the band is than its sides, by column: about 0 without a nail

    def search_px(self, column: float, row_from_middle: float) -> NDArray[np.float64]:
        """Pixel of the search image, shape (2,), of a column and row of the band."""
        along = self.first_along_px + column
        return self.band.centre_px + along * self.band.along + row_from_middle * self.band.across

    @property
    def clear_darkness(self) -> float:
        """Darkness where the band lies in the clear: neither beyond its tip nor across or beside something dark."""
        if not self.valid.any():
            return 0.0
        return float(np.quantile(self.darkness[self.valid], NAIL_HOLE_SEARCH.clear_quantile))


@dataclass(frozen=True, slots=True, eq=False)
class HolePattern:
    """The nail's holes found along a band."""

    strip: StraightenedBand  # where they were found
    # One opening per hole of the nail file, in its order, in pixels of the search image, shape (N, 2)
    centre_search_px: NDArray[np.float64]
    px_per_mm: float  # scale along the band, in pixels of the search image
    distal_sign: int  # +1 when the nail's +x runs along `strip.band.along`, else -1
    # Brightness of each opening between the metal (0) and the band's sides (1), shape (N,)
    openness: NDArray[np.float64]
    # From 0 (the band runs on where this direction has the nail's tip) to 1 (it ends there); 0.5 when out of view
    tip_evidence: float
    # The same, against the band's darkness in the clear: also where the nail's origin is not on the nail; 0 out of view
    end_evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class OpennessProfile:
    """Openness of every column of a straightened band, as the middle of each of the nail's openings at one scale."""

    px_per_mm: float
    # Brightness between the metal (0) and the band's sides (1), at the best row, shape (N, columns)
    openness: NDArray[np.float64]
    row_from_middle: NDArray[np.float64]  # that row, shape (N, columns)


def straighten_band(image: SearchImage, band: Band) -> StraightenedBand:
    """Cut out a band with its surroundings."""
    height, width = image.grey.shape
    corners = np.array([(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)])
    along = (corners - band.centre_px) @ band.along
    half_rows = int(np.ceil(NAIL_HOLE_SEARCH.band_half_height * band.width_px))
    columns, rows = np.arange(np.floor(along.min()), np.ceil(along.max()) + 1), np.arange(-half_rows, half_rows + 1)
    points = band.centre_px + columns[None, :, None] * band.along + rows[:, None, None] * band.across
    points = points.astype(np.float32)
    grey = cv2.remap(image.grey, points[..., 0], points[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    valid = cv2.remap(image.valid.astype(np.uint8), points[..., 0], points[..., 1], cv2.INTER_NEAREST) > 0
    used = np.flatnonzero(valid[half_rows])
    keep = slice(int(used[0]), int(used[-1]) + 1) if used.size else slice(0, 1)
    cut, valid = np.asarray(grey[:, keep], dtype=np.float32), valid[:, keep]
    across = np.abs(rows) / band.width_px
    settings = NAIL_HOLE_SEARCH
    inside = _mean_of_rows(cut, valid, (across > settings.metal_from) & (across < settings.metal_to))
    beside = (across > settings.beside_from) & (across < settings.beside_to)
    outside = np.minimum(_mean_of_rows(cut, valid, beside & (rows < 0)), _mean_of_rows(cut, valid, beside & (rows > 0)))
    return StraightenedBand(band, cut, valid[half_rows], float(columns[keep.start]), outside - inside)


def _mean_of_rows(grey: NDArray[np.float32], valid: NDArray[np.bool_], rows: NDArray[np.bool_]) -> NDArray[np.float64]:
    weight = valid[rows].astype(np.float64)
    total = weight.sum(axis=0)
    mean = (grey[rows] * weight).sum(axis=0) / np.maximum(total, 1.0)
    return np.asarray(np.where(total > 0.0, mean, 0.0))


def find_pattern(strip: StraightenedBand, nail: NailPart) -> tuple[HolePattern, HolePattern]:
    """Best places of all holes for each of the two directions of the nail: along the band, and against it.

    The scale is free within what the band's width allows, the place along the band is free; every hole must be a
    brighter patch with dark metal on both sides along the band.
    """
    scales = np.linspace(NAIL_HOLE_SEARCH.least_scale, NAIL_HOLE_SEARCH.largest_scale, NAIL_HOLE_SEARCH.scales)
    levels = [_openness_profile(strip, nail, strip.band.width_px / nail.diameter_mm * scale) for scale in scales]
    return _best_pattern(strip, nail, levels, +1), _best_pattern(strip, nail, levels, -1)


def _best_pattern(strip: StraightenedBand, nail: NailPart, levels: list[OpennessProfile], sign: int) -> HolePattern:
    hole_x_mm = sign * hole_midpoints_mm(nail)[:, 0]
    scored = [_best_column(level.openness, hole_x_mm * level.px_per_mm) for level in levels]
    best = int(np.argmax([total for total, _ in scored]))
    level, column = levels[best], scored[best][1]
    columns = np.clip(column + hole_x_mm * level.px_per_mm, 0, level.openness.shape[1] - 1)
    nearest = np.arange(len(columns)), np.rint(columns).astype(np.int64)
    places = zip(columns, level.row_from_middle[nearest], strict=True)
    centres = np.array([strip.search_px(float(c), float(r)) for c, r in places])
    px_per_mm = sign * level.px_per_mm
    tip = _tip_evidence(strip, nail, column, px_per_mm, _darkness_about(strip, column))
    end = _tip_evidence(strip, nail, column, px_per_mm, strip.clear_darkness)
    return HolePattern(
        strip,
        centres,
        level.px_per_mm,
        sign,
        level.openness[nearest],
        tip_evidence=0.5 if tip is None else tip,
        end_evidence=end or 0.0,
    )


def _openness_profile(strip: StraightenedBand, nail: NailPart, px_per_mm: float) -> OpennessProfile:
    radius = 0.5 * float(np.mean([hole.diameter_mm for hole in nail.holes])) * px_per_mm
    middle = strip.grey.shape[0] // 2
    reach = max(int(NAIL_HOLE_SEARCH.lateral_reach * strip.band.width_px), 1)
    rows = slice(middle - reach, middle + reach + 1)
    disc = _mean_of_disc(strip.grey, rows, NAIL_HOLE_SEARCH.disc_in_radii * radius)
    side = _mean_of_disc(strip.grey, rows, NAIL_HOLE_SEARCH.side_disc_in_radii * radius)
    darkness = max(strip.clear_darkness, NAIL_HOLE_SEARCH.least_darkness)

    def profile(half_slot_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        gap = int(np.rint(NAIL_HOLE_SEARCH.side_distance_in_radii * radius + half_slot_mm * px_per_mm))
        contrast = disc - np.maximum(np.roll(side, gap, axis=1), np.roll(side, -gap, axis=1))
        openness = contrast.max(axis=0).astype(np.float64) / darkness
        openness[~strip.valid] = _NOT_A_HOLE
        openness[:gap], openness[-gap:] = _NOT_A_HOLE, _NOT_A_HOLE
        return openness, (contrast.argmax(axis=0) - reach).astype(np.float64)

    profiles = {hole.half_slot_mm: profile(hole.half_slot_mm) for hole in nail.holes}
    openness, rows_from_middle = (
        np.stack([profiles[hole.half_slot_mm][part] for hole in nail.holes]) for part in range(2)
    )
    return OpennessProfile(px_per_mm, openness, rows_from_middle)


def _mean_of_disc(grey: NDArray[np.float32], rows: slice, radius: float) -> NDArray[np.float32]:
    """Mean over a disc about every pixel of some rows."""
    half = int(np.ceil(radius))
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    kernel = np.clip(radius + 0.5 - np.hypot(x, y), 0.0, 1.0).astype(np.float32)
    above = min(half, rows.start)
    around = grey[rows.start - above : rows.stop + half]
    means = cv2.filter2D(around, cv2.CV_32F, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(means[above : above + rows.stop - rows.start])


def _best_column(openness: NDArray[np.float64], offsets_px: NDArray[np.float64]) -> tuple[float, float]:
    """Column of the nail's origin at which the holes are brightest together; the dimmest hole counts double."""
    columns = np.arange(openness.shape[1], dtype=np.float64)
    at_holes = np.stack(
        [
            np.interp(columns + offset, columns, of_hole, left=_NOT_A_HOLE, right=_NOT_A_HOLE)
            for of_hole, offset in zip(openness, offsets_px, strict=True)
        ]
    )
    # A very bright hole must not make up for a dim one; but flat out it would leave ties among places and scales.
    capped = np.minimum(at_holes, 1.0 + NAIL_HOLE_SEARCH.beyond_open * (at_holes - 1.0))
    total = capped.mean(axis=0) + capped.min(axis=0)
    best = int(np.argmax(total))
    return float(total[best]), float(best)


def _tip_evidence(
    strip: StraightenedBand, nail: NailPart, origin_column: float, px_per_mm: float, reference: float
) -> float | None:
    """Compare the band's darkness just before and just after where the tip should be; None when that is out of view."""
    tip_mm, settings = nail.tip_x_mm, NAIL_HOLE_SEARCH
    first, last = tip_mm - settings.tip_before_from_mm, tip_mm - settings.tip_before_to_mm
    before = _darkness_between(strip, origin_column, px_per_mm, first, last)
    first, last = tip_mm + settings.tip_after_from_mm, tip_mm + settings.tip_after_to_mm
    after = _darkness_between(strip, origin_column, px_per_mm, first, last)
    if before is None or after is None:
        return None
    least = max(reference, NAIL_HOLE_SEARCH.least_darkness)
    before, after = before / least, after / least
    return float(np.clip(before, 0.0, 1.0) * (1.0 - np.clip(after, 0.0, 1.0)))


def _darkness_between(
    strip: StraightenedBand, origin_column: float, px_per_mm: float, from_mm: float, to_mm: float
) -> float | None:
    """Median darkness of a stretch; None when it is out of view."""
    ends = sorted(origin_column + px_per_mm * x for x in (from_mm, to_mm))
    columns = np.arange(round(ends[0]), round(ends[1]) + 1)
    if columns.size == 0 or columns[0] < 0 or columns[-1] >= strip.valid.size or not strip.valid[columns].all():
        return None
    return float(np.median(strip.darkness[columns]))


def _darkness_about(strip: StraightenedBand, column: float) -> float:
    """Median darkness about a column."""
    reach, middle = NAIL_HOLE_SEARCH.reference_reach_px, round(column)
    near = np.clip(np.arange(middle - reach, middle + reach + 1), 0, strip.valid.size - 1)
    return float(np.median(strip.darkness[near]))


def hole_midpoints_mm(nail: NailPart) -> NDArray[np.float64]:
    """Middle of each hole inside the metal, shape (N, 3), in the nail's frame."""
    return np.array([np.mean(hole_surface_points(nail, hole), axis=0) for hole in nail.holes])
