"""Pick how patient, nail and robot lie, so that the robot can bring its guide onto the nail's holes."""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Bone, Guide, Nail, RobotBase, RobotTop, Room
from shared.geometry.hexapod import PlatformPose, base_from_top, platform_pose
from shared.geometry.hexapod_limits import limit_margins, path_violations
from shared.geometry.transform import Transform
from simulation.scenario.files import PlacementRanges, ScenarioInvalid
from simulation.scenario.values import Parts, Placement, Side

_ATTEMPTS = 400
_TRAVEL_STEPS = 9


def sample_placement(
    ranges: PlacementRanges, parts: Parts, drilled_from: Side, head_extension_mm: float, generator: np.random.Generator
) -> Placement:
    """Pick until the robot can correct the guide's error within its limits and the margins that the ranges ask for.

    Raises
    ------
    ScenarioInvalid
        When none of 400 attempts can be corrected.
    """
    try:
        head = parts.hexapod.top_from_guide(head_extension_mm)
    except ValueError as error:
        raise ScenarioInvalid(str(error)) from None
    room_from_bone = _patient(ranges, drilled_from, generator)
    bone_from_nail = _nail_in_bone(ranges, generator)
    for _ in range(_ATTEMPTS):
        bone_from_base = _mount(ranges, parts, head, bone_from_nail, generator)
        placement = Placement(room_from_bone, bone_from_nail, bone_from_base)
        if correcting_pose(ranges, parts, head, placement) is not None:
            return placement
    raise ScenarioInvalid(
        f"none of {_ATTEMPTS} placements within guide_offset_mm {ranges.guide_offset_mm} and guide_tilt_deg "
        f"{ranges.guide_tilt_deg} can be corrected by '{parts.hexapod.name}' with its head at {head_extension_mm:g} mm;"
        " narrow these ranges"
    )


def _patient(ranges: PlacementRanges, drilled_from: Side, generator: np.random.Generator) -> Transform[Room, Bone]:
    """Room: x to the patient's feet, y to the left, z up. A femur is drilled into from its own side."""
    inwards = 1.0 if drilled_from is Side.RIGHT else -1.0
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, inwards], [0.0, -inwards, 0.0]])
    offset = generator.uniform(*ranges.bone_offset_from_isocentre_mm, size=3)
    turn = np.radians(generator.uniform(*ranges.bone_turn_in_room_deg, size=3))
    lying: Transform[Room, Bone] = Transform.from_rotation_translation(axes, offset)
    turned: Transform[Bone, Bone] = Transform.from_rotvec(turn, np.zeros(3))
    return lying @ turned


def _nail_in_bone(ranges: PlacementRanges, generator: np.random.Generator) -> Transform[Bone, Nail]:
    offset = generator.uniform(*ranges.nail_offset_in_bone_mm, size=2)
    tilt = generator.uniform(*ranges.nail_tilt_in_bone_deg, size=2)
    roll = generator.uniform(*ranges.nail_roll_in_bone_deg)
    return Transform.from_rotvec(np.radians([roll, *tilt]), [0.0, *offset])


def aligned_guide(parts: Parts, standoff_mm: float) -> Transform[Nail, Guide]:
    """Where the guide's holes lie on the nail's, at a distance of the guide's origin from the nail's axis."""
    nail = {h.id: h.axis for h in parts.nail.holes}
    pairs = [(nail[h.id], h.axis) for h in parts.guide.holes if h.id in nail]
    if not pairs:
        raise ScenarioInvalid("guide and nail have no hole of the same id; name parts that belong together")
    shift = np.mean([n.point_mm - g.point_mm for n, g in pairs], axis=0)
    return Transform.from_rotation_translation(np.eye(3), [shift[0], shift[1], -standoff_mm])


def _mount(
    ranges: PlacementRanges,
    parts: Parts,
    head: Transform[RobotTop, Guide],
    bone_from_nail: Transform[Bone, Nail],
    generator: np.random.Generator,
) -> Transform[Bone, RobotBase]:
    """A base that leaves the guide, in the home pose, off its holes by a random amount."""
    g = generator
    standoff = g.uniform(*ranges.guide_standoff_mm)
    offset, tilt = g.uniform(*ranges.guide_offset_mm), np.radians(g.uniform(*ranges.guide_tilt_deg))
    twist = np.radians(g.uniform(*ranges.guide_twist_deg))
    to_side, about = g.uniform(-np.pi, np.pi, size=2)
    error: Transform[Guide, Guide] = Transform.from_rotvec(
        [tilt * np.cos(about), tilt * np.sin(about), twist], [offset * np.cos(to_side), offset * np.sin(to_side), 0.0]
    )
    hexapod = parts.hexapod
    base_from_guide = base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm) @ head
    return bone_from_nail @ aligned_guide(parts, standoff) @ error @ base_from_guide.inverse()


def correcting_pose(
    ranges: PlacementRanges, parts: Parts, head: Transform[RobotTop, Guide], placement: Placement
) -> PlatformPose | None:
    """A pose that puts the guide's holes on the nail's, reached straight from home; None when there is none.

    The guide may travel freely along its holes; the middle of the allowed travel is tried first.
    """
    hexapod = parts.hexapod
    base_from_nail = placement.bone_from_base.inverse() @ placement.bone_from_nail
    home_guide = base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm) @ head
    standoff = -float((base_from_nail.inverse() @ home_guide.translation_mm)[2])
    poses = [
        _pose_at(parts, head, base_from_nail, standoff + travel)
        for travel in sorted(np.linspace(*ranges.free_travel_mm, _TRAVEL_STEPS), key=abs)
    ]
    array: NDArray[np.float64] = np.array([p.as_array() for p in poses])
    leg_mm, joint_deg = limit_margins(hexapod, array, hexapod.pivot_mm)
    fits = np.flatnonzero((leg_mm >= ranges.leg_margin_mm) & (joint_deg >= ranges.joint_margin_deg))
    for i in fits:
        if not path_violations(hexapod, hexapod.home_pose, poses[i], hexapod.pivot_mm):
            return poses[i]
    return None


def _pose_at(
    parts: Parts, head: Transform[RobotTop, Guide], base_from_nail: Transform[RobotBase, Nail], standoff_mm: float
) -> PlatformPose:
    target = base_from_nail @ aligned_guide(parts, standoff_mm) @ head.inverse()
    return platform_pose(parts.hexapod, target, parts.hexapod.pivot_mm)
