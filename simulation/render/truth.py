"""What is true about an image and about the room: exact poses, holes, wires and balls.

The camera's frame is that of the image after un-mirroring and with its rotation kept, as everywhere in the project.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Camera, Guide, Nail, Ring
from shared.geometry.lines import Line, across_axis_offset_mm, angle_between_rad
from shared.geometry.parts import Hole, hole_surface_points
from shared.geometry.transform import Transform
from simulation.render.display import turned_from_detector, turned_points
from simulation.render.scene import BallsInView
from simulation.scenario.frames import Beam
from simulation.scenario.values import Scenario
from simulation.world.poses import World, mapped

Floats = NDArray[np.float64]
_OVER_METAL_MM = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class HoleTruth:
    """A nail hole as the guide sees it.

    Attributes
    ----------
    entry_point_guide_mm, axis_guide
        Where its axis meets the nail's surface on the side of drilling, and its direction, shape (3,) each.
    tilt_to_ray_deg
        Angle between the axis and the X-ray through the hole's middle.
    """

    id: str
    entry_point_guide_mm: Floats
    axis_guide: Floats
    tilt_to_ray_deg: float


@dataclass(frozen=True, slots=True)
class AxisError:
    """One straight thing (guide hole, wire, drill) against the nail hole's axis of the same id."""

    id: str
    entry_offset_mm: float
    exit_offset_mm: float
    angle_deg: float


@dataclass(frozen=True, slots=True)
class BallTruth:
    """A ball's centre in the detector's turned, un-mirrored image."""

    id: str
    image_px: tuple[float, float]
    undistorted_px: tuple[float, float]
    radius_px: float
    in_view: bool
    over_metal: bool
    touches_ball: bool


@dataclass(frozen=True, slots=True, eq=False)
class ImageTruth:
    """Everything that an estimator could want to know about one image; absent parts are None."""

    intrinsic_matrix_px: Floats
    mirrored: bool
    camera_from_ring: Transform[Camera, Ring]
    camera_from_guide: Transform[Camera, Guide] | None
    camera_from_nail: Transform[Camera, Nail] | None
    guide_from_nail: Transform[Guide, Nail]
    holes: tuple[HoleTruth, ...]
    wires: tuple[AxisError, ...]
    balls: tuple[BallTruth, ...]


def axis_error(scenario: Scenario, hole: Hole, axis_nail: Line) -> AxisError:
    """How far a line, in the nail's frame, is off a nail hole's axis at the hole's entry and exit."""
    entry, leave = hole_surface_points(scenario.parts.nail, hole)
    return AxisError(
        hole.id,
        across_axis_offset_mm(hole.axis, axis_nail, entry),
        across_axis_offset_mm(hole.axis, axis_nail, leave),
        float(np.degrees(angle_between_rad(hole.axis.direction, axis_nail.direction))),
    )


def guide_axis_errors(scenario: Scenario, world: World) -> tuple[AxisError, ...]:
    """True errors of the guide's holes against the nail's holes of the same id."""
    nail_from_guide = world.guide_from_nail.inverse()
    nail_holes = {h.id: h for h in scenario.parts.nail.holes}
    return tuple(
        axis_error(scenario, nail_holes[h.id], mapped(nail_from_guide, h.axis))
        for h in scenario.parts.guide.holes
        if h.id in nail_holes
    )


def wire_errors(scenario: Scenario, world: World) -> tuple[AxisError, ...]:
    """True errors of the inserted wires against the nail's holes."""
    nail_from_bone = scenario.placement.bone_from_nail.inverse()
    holes = {h.id: h for h in scenario.parts.nail.holes}
    return tuple(
        axis_error(scenario, holes[w.hole_id], mapped(nail_from_bone, w.axis))
        for w in world.state.wires
        if w.hole_id in holes
    )


def image_truth(
    scenario: Scenario, world: World, balls: BallsInView, window: NDArray[np.float32], metal_mm: Floats
) -> ImageTruth:
    """Truth of one image.

    Parameters
    ----------
    window
        Visible part of the detector's image, shape (rows, columns), 0 to 1.
    metal_mm
        Path through metal other than balls behind each ball's centre, shape (N,).
    """
    camera_from_beam: Transform[Camera, Beam] = Transform.from_rotation_translation(
        turned_from_detector(scenario.display), np.zeros(3)
    )
    size = scenario.c_arm.size_px
    K = world.intrinsic_matrix_px.copy()
    K[:2, 2] = turned_points(scenario.display, K[:2, 2], size)
    state = world.state
    return ImageTruth(
        intrinsic_matrix_px=K,
        mirrored=scenario.display.mirrored,
        camera_from_ring=camera_from_beam @ world.beam_from_ring,
        camera_from_guide=camera_from_beam @ world.beam_from_guide if state.guide_present else None,
        camera_from_nail=camera_from_beam @ world.beam_from_nail if state.nail_present else None,
        guide_from_nail=world.guide_from_nail,
        holes=hole_truths(scenario, world),
        wires=wire_errors(scenario, world),
        balls=_ball_truths(scenario, balls, window, metal_mm),
    )


def hole_truths(scenario: Scenario, world: World) -> tuple[HoleTruth, ...]:
    """The nail's holes as the guide sees them."""
    return tuple(_hole_truth(scenario, world, hole) for hole in scenario.parts.nail.holes)


def _hole_truth(scenario: Scenario, world: World, hole: Hole) -> HoleTruth:
    entry, leave = hole_surface_points(scenario.parts.nail, hole)
    middle_beam = world.beam_from_nail @ (0.5 * (entry + leave))
    axis_beam = world.beam_from_nail.directions(hole.axis.direction)
    tilt = np.degrees(angle_between_rad(axis_beam, middle_beam))
    return HoleTruth(
        hole.id, world.guide_from_nail @ entry, world.guide_from_nail.directions(hole.axis.direction), float(tilt)
    )


def _ball_truths(
    scenario: Scenario, balls: BallsInView, window: NDArray[np.float32], metal_mm: Floats
) -> tuple[BallTruth, ...]:
    size = scenario.c_arm.size_px
    nearest = np.rint(balls.image_px).astype(int)
    inside = np.all((nearest >= 0) & (nearest < size), axis=1)
    column, row = np.clip(nearest, 0, size - 1).T
    in_view = inside & (window[row, column] > 0.5)
    apart = np.linalg.norm(balls.image_px[:, None] - balls.image_px[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    touches = np.any(apart < balls.radius_px[:, None] + balls.radius_px[None], axis=1)
    image, ideal = (turned_points(scenario.display, p, size) for p in (balls.image_px, balls.ideal_px))
    return tuple(
        BallTruth(
            name,
            (float(image[i, 0]), float(image[i, 1])),
            (float(ideal[i, 0]), float(ideal[i, 1])),
            float(balls.radius_px[i]),
            bool(in_view[i]),
            bool(metal_mm[i] > _OVER_METAL_MM),
            bool(touches[i]),
        )
        for i, name in enumerate(balls.ids)
    )
