"""Where the search for the nail ends before anything refuses it: at the true optimum, at a wrong one, or nowhere.

The search starts from no guess: the whole image, no tilt. Its end is compared with the truth in the ring's frame, so
that a guide that was not found does not matter.
"""

from dataclasses import replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.methods import LARGEST_AXIS_ERROR_DEG, LARGEST_ENTRY_ERROR_MM, ModelRun
from services.registration.core.localise import Parts, unmirrored
from services.registration.core.nail.left_out import covered_pixels
from services.registration.core.nail.occluders import Occluders, PlacedGuide, ball_discs_px
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.search.find import find_nail
from services.registration.core.nail.tilt_ambiguity import find_global_optimum
from shared.errors import Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail, Ring
from shared.geometry.lines import Line, angle_between_rad
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform


class Capture(StrEnum):
    """Where the search ended."""

    RIGHT = "right"
    WRONG = "wrong"
    NOWHERE = "nowhere"


def capture_of(
    pixels: NDArray[np.float32], run: ModelRun, parts: Parts, ring_from_nail: Transform[Ring, Nail]
) -> Capture:
    """Where the search ended in an image, whatever was refused afterwards.

    Parameters
    ----------
    run
        What our own method made of the image; its pose is taken where it has one, else the search is run again.
    ring_from_nail
        The truth.
    """
    if run.calibration is None or run.result is None:
        return Capture.NOWHERE
    nail = run.result.nail
    pose = _searched(pixels, run, run.calibration, parts) if nail is None else nail.camera_from_nail
    if pose is None:
        return Capture.NOWHERE
    found = run.calibration.camera_from_ring.inverse() @ pose
    return Capture.RIGHT if is_right(parts.nail, found, ring_from_nail) else Capture.WRONG


def is_right(nail: NailPart, found: Transform[Ring, Nail], true: Transform[Ring, Nail]) -> bool:
    """Whether no hole's axis is off by more than an accepted one may be."""
    for hole in nail.holes:
        entry, _ = hole_surface_points(nail, hole)
        axis = Line(true @ entry, true.directions(hole.axis.direction))
        off_mm = axis.distance_mm(found @ entry)
        off_deg = np.degrees(angle_between_rad(axis.direction, found.directions(hole.axis.direction)))
        if not (off_mm <= LARGEST_ENTRY_ERROR_MM and off_deg <= LARGEST_AXIS_ERROR_DEG):
            return False
    return True


def _searched(
    pixels: NDArray[np.float32], run: ModelRun, calibration: CArmCalibration, parts: Parts
) -> Transform[Camera, Nail] | None:
    """The pose with which the search would have gone into its last stage."""
    guide = None if run.result is None else run.result.guide
    upright = unmirrored(pixels, calibration)
    distal = None if guide is None else guide.camera_from_guide.directions(np.array([1.0, 0.0, 0.0]))
    start = find_nail(upright, calibration, parts.nail, distal)
    if isinstance(start, Rejected):
        return None
    placed = None if guide is None else PlacedGuide(parts.guide, guide.camera_from_guide)
    balls = Occluders(placed, parts.ring)
    depth_mm = float(start.value.camera_from_nail.translation_mm[2])
    hidden = covered_pixels(upright, calibration, start.value.openings, depth_mm, ball_discs_px(balls, calibration))
    given = FitInput(upright, calibration, parts.nail, replace(balls, hidden=hidden))
    winner = find_global_optimum(given, start.value.camera_from_nail)
    return None if winner is None else winner.camera_from_nail
