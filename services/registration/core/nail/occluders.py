"""Known things that lie in front of or behind the nail: guide (balls, body), the ring's balls, K-wires."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.paths import Balls, add_ball_paths, guide_body_path
from services.registration.core.nail.penumbra import Penumbra
from services.registration.core.nail.pixel_rays import FIRST_SAMPLES, SAMPLES_PX, PixelRays, sample_directions
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
    rays: PixelRays, occluders: Occluders, calibration: CArmCalibration, penumbra: Penumbra
) -> NDArray[np.float64]:
    """Length in steel (balls of guide and ring, wires) at the `SAMPLES_PX` in each of S pixels; (S, samples), in mm."""
    out = np.zeros((len(rays.slopes), len(SAMPLES_PX)))
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        balls = Balls(np.ascontiguousarray(centres_mm), 0.5 * diameters_mm, penumbra.spread(centres_mm[:, 2]))
        add_ball_paths(rays, SAMPLES_PX, balls, out)
    # wires pass through the nail: its penumbra is theirs
    for rod in occluders.rods:
        add_rod_path(sample_directions(rays, SAMPLES_PX), rod, out.reshape(-1))
    return out


def ball_discs_px(occluders: Occluders, calibration: CArmCalibration) -> NDArray[np.float64]:
    """Where balls of guide and ring are in the image: centre x, y and radius in measured pixels, shape (B, 3)."""
    discs = [np.zeros((0, 3))]
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        radius_px = 0.5 * diameters_mm * calibration.camera.focal_length_px / centres_mm[:, 2]
        discs.append(np.column_stack([calibration.image_from_camera(centres_mm), radius_px]))
    return np.concatenate(discs)


def delrin_path_mm(rays: PixelRays, occluders: Occluders, penumbra: Penumbra) -> NDArray[np.float64]:
    """Mean length in the guide's body over a few places in each of S pixels, shape (S,), in mm."""
    guide = occluders.guide
    if guide is None or not guide.part.body:
        return np.zeros(len(rays.slopes))
    middle_mm = np.mean([box.centre_mm for box in guide.part.body], axis=0)
    spread = penumbra.spread((guide.camera_from_guide @ middle_mm)[2])
    return guide_body_path(rays, spread * SAMPLES_PX[:FIRST_SAMPLES], guide.camera_from_guide, guide.part)


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
