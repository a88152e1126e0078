"""Known things that lie in front of or behind the nail: guide (balls, body), the ring's balls, K-wires."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.paths import add_ball_paths, guide_body_path
from services.registration.core.nail.pixel_rays import PixelRays
from services.registration.core.nail.rods import SteelRod, add_rod_path
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class PlacedGuide:
    """A guide and where it is."""

    part: GuidePart
    camera_from_guide: Transform[Camera, Guide]


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """What shares the image with the nail. `None`: not there, or not known.

    Attributes
    ----------
    guide, ring
        Have a known shape and place, and are modelled.
    hidden
        Pixels where something of unknown shape covers the nail, shape (rows, columns): they are left out.
    rods
        K-wires of known place, modelled too.
    """

    guide: PlacedGuide | None
    ring: RingPart | None
    hidden: NDArray[np.bool_] | None = None
    rods: tuple[SteelRod, ...] = ()


def steel_path_mm(
    directions: NDArray[np.float64], occluders: Occluders, calibration: CArmCalibration
) -> NDArray[np.float64]:
    """Length of rays, directions of shape (N, 2) at z = 1, in steel: balls of guide and ring, wires; (N,), in mm."""
    out = np.zeros(len(directions))
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        add_ball_paths(directions, np.ascontiguousarray(centres_mm), 0.5 * diameters_mm, out)
    for rod in occluders.rods:
        add_rod_path(directions, rod, out)
    return out


def ball_discs_px(occluders: Occluders, calibration: CArmCalibration) -> NDArray[np.float64]:
    """Where balls of guide and ring are in the image: centre x, y and radius in measured pixels, shape (B, 3)."""
    discs = [np.zeros((0, 3))]
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        radius_px = 0.5 * diameters_mm * calibration.camera.focal_length_px / centres_mm[:, 2]
        discs.append(np.column_stack([calibration.image_from_camera(centres_mm), radius_px]))
    return np.concatenate(discs)


def delrin_path_mm(rays: PixelRays, places_px: NDArray[np.float64], occluders: Occluders) -> NDArray[np.float64]:
    """Mean length in the guide's body over some places within each of S pixels, shape (S,), in mm."""
    if occluders.guide is None:
        return np.zeros(len(rays.slopes))
    return guide_body_path(rays, places_px, occluders.guide.camera_from_guide, occluders.guide.part)


def _balls_camera(
    occluders: Occluders, calibration: CArmCalibration
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    groups = []
    if occluders.guide is not None:
        balls = occluders.guide.part.balls
        groups.append((occluders.guide.camera_from_guide.points(balls.position_mm), balls.diameter_mm))
    if occluders.ring is not None:
        balls = occluders.ring.balls
        groups.append((calibration.camera_from_ring.points(balls.position_mm), balls.diameter_mm))
    return groups
