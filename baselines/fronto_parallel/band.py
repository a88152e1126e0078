"""The paper's search for the nail: a Hough transform for bands, two parallel lines with darkness between them.

Direction, distance from the origin and width make it three-dimensional. "The voting scheme is constrained so that
pixels on parallel lines will only cast their vote if the grey values between them are lower than those outside."
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.edges import EdgeImage
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import NailPart

# The nail lies 200 to 300 mm from the detector; with some margin, for the calibration's plane is not the detector.
_BEFORE_RING_MM = (130.0, 360.0)
_ANGLE_STEP_DEG = 1.0
_ANGLE_SPREAD = (-2, -1, 0, 1, 2)
_OFFSET_STEP_PX = 1.0
_WIDTH_STEP_PX = 1.0
_OUTSIDE_SHARE = 0.2
_NEAR_PX = (3.0, 2.5, 2.0, 1.5, 1.2)
_ALIGNED = 0.97
_LEAST_ELEMENTS = 60
_SEEN_SHARE, _GAP_CELLS = 0.4, 3


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Two parallel lines in the dewarped image.

    Attributes
    ----------
    along
        Unit direction of the lines, shape (2,).
    middle_px
        Signed distance of the medial line from the image's first pixel, along `across`.
    width_px
        Distance between the lines.
    reach_px
        From where to where along the band both lines are seen, measured along `along`.
    elements
        Edge elements on the two lines.
    """

    along: NDArray[np.float64]
    middle_px: float
    width_px: float
    reach_px: tuple[float, float]
    elements: int

    @property
    def across(self) -> NDArray[np.float64]:
        """Unit normal of the lines, shape (2,)."""
        return np.array([-self.along[1], self.along[0]])


def find_band(image: EdgeImage, calibration: CArmCalibration, nail: NailPart) -> Band | None:
    """Find the band with most votes among those that may be the nail; None when hardly any edge votes."""
    depth_mm = float(calibration.camera_from_ring.translation_mm[2])
    widths = [nail.diameter_mm * calibration.camera.focal_length_px / (depth_mm - mm) for mm in _BEFORE_RING_MM]
    coarse = _most_votes(image, np.arange(widths[0], widths[1] + _WIDTH_STEP_PX, _WIDTH_STEP_PX))
    if coarse is None:
        return None
    refined = _refined(image, coarse)
    return refined if refined.elements >= _LEAST_ELEMENTS else None


def _most_votes(image: EdgeImage, widths_px: NDArray[np.float64]) -> Band | None:
    """Accumulate over direction and distance, one width after the other.

    Both lines must be seen: the smaller of their votes counts, so that one long edge is no band.
    """
    normals = int(180.0 / _ANGLE_STEP_DEG)
    reach = float(np.hypot(*image.grey.shape))
    bins = int(2.0 * reach / _OFFSET_STEP_PX) + 1
    best: tuple[float, int, int, float] | None = None
    for width in widths_px:
        votes = _votes(image, float(width), normals, reach, bins)
        score = np.minimum(votes[0], votes[1])
        k = int(np.argmax(score))
        if best is None or score.flat[k] > best[0]:
            best = (float(score.flat[k]), k // bins, k % bins, float(width))
    if best is None or best[0] <= 0.0:
        return None
    angle = np.radians(best[1] * _ANGLE_STEP_DEG)
    normal = np.array([np.cos(angle), np.sin(angle)])
    return Band(
        np.array([normal[1], -normal[0]]), best[2] * _OFFSET_STEP_PX - reach, best[3], (-reach, reach), int(best[0])
    )


def _votes(image: EdgeImage, width_px: float, normals: int, reach_px: float, bins: int) -> NDArray[np.float64]:
    """Votes of elements on the far (0) and the near (1) line for medial lines, shape (2, normals, bins)."""
    inside, opposite = (image.place_px - share * width_px * image.outward for share in (0.5, 1.0 + _OUTSIDE_SHARE))
    beyond = image.place_px + _OUTSIDE_SHARE * width_px * image.outward
    within = image.grey_at(inside)
    dark = (within < image.grey_at(beyond)) & (within < image.grey_at(opposite))
    place, outward = image.place_px[dark], image.outward[dark]
    angle = np.degrees(np.arctan2(outward[:, 1], outward[:, 0])) % 360.0
    votes = np.zeros((2, normals, bins))
    for spread in _ANGLE_SPREAD:
        index = np.rint(angle / _ANGLE_STEP_DEG).astype(np.int64) + spread
        side, normal = (index // normals) % 2, index % normals
        sign = 1.0 - 2.0 * side
        turned = np.radians(normal * _ANGLE_STEP_DEG)
        offset = place[:, 0] * np.cos(turned) + place[:, 1] * np.sin(turned) - sign * 0.5 * width_px
        cell = np.clip(np.rint((offset + reach_px) / _OFFSET_STEP_PX), 0, bins - 1).astype(np.int64)
        np.add.at(votes, (side, normal, cell), 1.0)
    # neighbouring distances together, as lines a degree apart leave one another by a pixel in sixty
    votes[:, :, 1:-1] = votes[:, :, :-2] + votes[:, :, 1:-1] + votes[:, :, 2:]
    return votes


def _refined(image: EdgeImage, band: Band) -> Band:
    """Least squares through the elements near both lines, which share one direction."""
    for near in _NEAR_PX:
        upper, lower = _on_lines(image, band, near)
        counts = int(np.count_nonzero(upper)), int(np.count_nonzero(lower))
        if min(counts) < _LEAST_ELEMENTS // 4:
            break
        along = np.concatenate([image.place_px[upper], image.place_px[lower]]) @ band.along
        across = np.concatenate([image.place_px[upper], image.place_px[lower]]) @ band.across
        is_upper = np.repeat([1.0, 0.0], counts)
        design = np.column_stack([along, is_upper, 1.0 - is_upper])
        (slope, first, second), *_ = np.linalg.lstsq(design, across, rcond=None)
        shrink = 1.0 / float(np.hypot(1.0, slope))
        turned = (band.along + slope * band.across) * shrink
        middle, width = 0.5 * float(first + second) * shrink, float(first - second) * shrink
        band = Band(turned, middle, width, _reach(along[is_upper > 0], along[is_upper == 0], width), len(along))
    return band


def _on_lines(image: EdgeImage, band: Band, near_px: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which elements lie on the upper and the lower line and face away from the band, shape (N,) each."""
    offset = image.place_px @ band.across - band.middle_px
    facing = image.outward @ band.across
    upper = (np.abs(offset - 0.5 * band.width_px) < near_px) & (facing > _ALIGNED)
    return upper, (np.abs(offset + 0.5 * band.width_px) < near_px) & (facing < -_ALIGNED)


def _reach(upper_px: NDArray[np.float64], lower_px: NDArray[np.float64], width_px: float) -> tuple[float, float]:
    """The longest stretch on which both lines are seen, interruptions of a band's width not counted."""
    low, cell = float(min(upper_px.min(), lower_px.min())), 0.5 * width_px
    cells = int((max(upper_px.max(), lower_px.max()) - low) / cell) + 1
    counts = [np.bincount(((line - low) / cell).astype(np.int64), minlength=cells) for line in (upper_px, lower_px)]
    seen = np.flatnonzero(np.minimum(counts[0], counts[1]) > _SEEN_SHARE * cell)
    if not len(seen):
        return low, low
    runs = np.split(seen, np.flatnonzero(np.diff(seen) > _GAP_CELLS) + 1)
    longest = max(runs, key=lambda run: int(run[-1] - run[0]))
    return low + float(longest[0]) * cell, low + float(longest[-1] + 1) * cell
