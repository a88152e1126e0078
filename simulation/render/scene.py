"""Pack the world's shapes, in the beam's frame, for the ray tracer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Nail
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Hole
from shared.geometry.transform import Transform
from simulation.render import tracer
from simulation.render.anatomy import bone_shapes, spongy_row
from simulation.render.attenuation import Material
from simulation.render.distortion import measured_from_ideal
from simulation.render.rows import Shapes, bar_row, block_row, ellipsoid_row, joined
from simulation.render.texture import VOXEL_MM, trabecular_volume
from simulation.render.tiles import TILE_PX, sort_into_tiles
from simulation.scenario.frames import Beam
from simulation.scenario.values import Scenario
from simulation.world.poses import Rod, World

Floats = NDArray[np.float64]

NAIL_LENGTH_MM = 330.0
_USUAL_CHAMFER_MM = 0.4
_BEYOND_MM = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class BallsInView:
    """All balls in the beam's frame, the ring's first.

    Attributes
    ----------
    ids, centre_mm, radius_mm
        Names, centres, shape (N, 3), and radii, shape (N,).
    image_px, ideal_px
        Where the centres appear in the detector's image, with and without distortion, shape (N, 2).
    radius_px
        Radius of the shadow, shape (N,).
    """

    ids: tuple[str, ...]
    centre_mm: Floats
    radius_mm: Floats
    image_px: Floats
    ideal_px: Floats
    radius_px: Floats


def balls_in_view(scenario: Scenario, world: World) -> BallsInView:
    """Balls of ring and guide (unless it was taken away), and where they appear."""
    groups: list[tuple[BallPattern, Floats]] = [
        (scenario.parts.ring.balls, world.beam_from_ring @ scenario.parts.ring.balls.position_mm)
    ]
    if world.state.guide_present:
        guide = scenario.parts.guide.balls
        groups.append((guide, world.beam_from_guide @ guide.position_mm))
    centre = np.concatenate([g[1] for g in groups])
    radius = 0.5 * np.concatenate([g[0].diameter_mm for g in groups])
    homogeneous = centre @ world.intrinsic_matrix_px.T
    ideal = homogeneous[:, :2] / homogeneous[:, 2:]
    c = scenario.c_arm
    image = measured_from_ideal(scenario.detector, ideal, c.size_px, c.pixel_mm, world.rotation_deg)
    shadow = radius * world.intrinsic_matrix_px[0, 0] / centre[:, 2]
    return BallsInView(tuple(i for g in groups for i in g[0].ids), centre, radius, image, ideal, shadow)


def pack_scene(scenario: Scenario, world: World, balls: BallsInView) -> tracer.PackedScene:
    """Everything that the X-rays meet."""
    state = world.state
    shapes = joined(
        [
            bone_shapes(scenario.anatomy, world.beam_from_bone),
            _nail_shapes(scenario, world) if state.nail_present else Shapes(),
            _guide_shapes(scenario, world) if state.guide_present else Shapes(),
            _plate_shapes(scenario, world),
            _rod_shapes(state.wires, world, tracer.STEEL_PART),
            _rod_shapes(state.drilled, world, tracer.DRILLED),
        ]
    )
    tiles = sort_into_tiles(balls.image_px, balls.radius_px, scenario.c_arm.size_px)
    material = Material.STEEL if scenario.parts.nail.material == "steel" else Material.TITANIUM
    boxes = _delrin_rows(scenario, world) if state.guide_present else np.zeros((0, 6))
    return tracer.PackedScene(
        ellipsoids=shapes.ellipsoid_rows(),
        ellipsoid_class=shapes.ellipsoid_classes(),
        bars=shapes.bar_rows(),
        bar_class=shapes.bar_classes(),
        blocks=shapes.block_rows(),
        block_class=shapes.block_classes(),
        delrin_boxes=boxes,
        delrin_axes=np.ascontiguousarray(world.beam_from_guide.rotation.T),
        steel_boxes=np.zeros((0, 6)),
        steel_box_axes=np.zeros((0, 3, 3)),
        tubes=shapes.tube_rows(),
        tube_class=shapes.tube_classes(),
        bone_from_camera=np.ascontiguousarray(world.beam_from_bone.inverse().matrix[:3]),
        balls=np.column_stack([balls.centre_mm, balls.radius_mm]),
        tile_start=tiles.start,
        tile_balls=tiles.balls,
        tiles_across=tiles.across,
        tile_px=TILE_PX,
        nail_material=int(material),
        texture=trabecular_volume(scenario.anatomy.texture_seed),
        texture_mm=VOXEL_MM,
        spongy=spongy_row(scenario.anatomy),
        detector_distance_mm=scenario.c_arm.source_to_detector_mm,
    )


def _nail_shapes(scenario: Scenario, world: World) -> Shapes:
    """Round bar with a round tip, cannulation, and bores whose rims are chamfered."""
    nail, pose = scenario.parts.nail, world.beam_from_nail
    radius, x = nail.radius_mm, np.array([1.0, 0.0, 0.0])
    axis = Line(np.zeros(3), x)
    tip = nail.tip_x_mm
    bars = [(tracer.NAIL, bar_row(pose, axis, radius, -NAIL_LENGTH_MM, tip - radius))]
    if nail.cannulation_diameter_mm > 0.0:
        bars.append(
            (tracer.NAIL_VOID, bar_row(pose, axis, 0.5 * nail.cannulation_diameter_mm, -NAIL_LENGTH_MM, tip + 1.0))
        )
    end = ellipsoid_row(pose, np.array([tip - radius, 0.0, 0.0]), np.full(3, radius))
    solid = Shapes(ellipsoids=((tracer.NAIL, end),), bars=tuple(bars))
    return joined([solid, *(hole_shapes(pose, hole, radius) for hole in nail.holes)])


def hole_shapes(pose: Transform[Beam, Nail], hole: Hole, radius_mm: float) -> Shapes:
    """A hole through a nail of some radius: its bore, and the chamfers of both rims; of a slot two, and between them.

    A piece of a bore reaches `from` to `to` along the axis, and is `flare` wider at each mm further along.
    """
    chamfer = _USUAL_CHAMFER_MM if hole.chamfer_mm is None else hole.chamfer_mm
    bore, half, along = 0.5 * hole.diameter_mm, hole.half_slot_mm, hole.along_nail()
    end = radius_mm / hole.cosine_across_nail
    rim = end - chamfer
    forwards, backwards = (Line(hole.axis.point_mm, side * hole.axis.direction) for side in (1.0, -1.0))
    pieces = [
        (forwards, bore, -_BEYOND_MM, _BEYOND_MM, 0.0),
        *((axis, bore - rim, rim, end + 1.0, 1.0) for axis in (forwards, backwards)),
    ]
    bars, blocks = [], []
    for axis, wide, first, last, flare in pieces:
        for shift in (-half, half) if half > 0.0 else (0.0,):
            moved = Line(axis.point_mm + shift * along, axis.direction)
            bars.append((tracer.NAIL_VOID, bar_row(pose, moved, wide, first, last, flare)))
        if half > 0.0:
            blocks.append((tracer.NAIL_VOID, block_row(pose, axis, along, (half, wide), first, last, flare)))
    return Shapes(bars=tuple(bars), blocks=tuple(blocks))


def _delrin_rows(scenario: Scenario, world: World) -> Floats:
    rows = [
        np.concatenate([world.beam_from_guide @ np.array(b.centre_mm), 0.5 * np.array(b.size_mm)])
        for b in scenario.parts.guide.body
    ]
    return np.array(rows).reshape(-1, 6)


def _guide_shapes(scenario: Scenario, world: World) -> Shapes:
    bores = [
        (tracer.DELRIN_VOID, bar_row(world.beam_from_guide, h.axis, 0.5 * h.diameter_mm, -_BEYOND_MM, _BEYOND_MM))
        for h in scenario.parts.guide.holes
    ]
    return Shapes(bars=tuple(bores))


def _plate_shapes(scenario: Scenario, world: World) -> Shapes:
    rows = []
    for plate in scenario.parts.ring.plates:
        axis = Line(np.array([0.0, 0.0, plate.z_mm]), np.array([0.0, 0.0, 1.0]))
        half = 0.5 * plate.thickness_mm
        rows.append((tracer.PLATE, bar_row(world.beam_from_ring, axis, plate.radius_mm, -half, half)))
    return Shapes(bars=tuple(rows))


def _rod_shapes(rods: tuple[Rod, ...], world: World, kind: int) -> Shapes:
    rows = [(kind, bar_row(world.beam_from_bone, r.axis, 0.5 * r.diameter_mm, r.start_mm, r.end_mm)) for r in rods]
    return Shapes(bars=tuple(rows))
