"""Where everything is: a pure function of the scenario, the robot's platform, the C-arm's angles and what was inserted.

`World` holds all poses in the frame of the beam: focal spot at the origin, axes along the detector's columns and rows.
"""

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Bone, Frame, Guide, Nail, Ring, RobotBase, RobotTop, Room
from shared.geometry.hexapod import base_from_top
from shared.geometry.lines import Line
from shared.geometry.transform import Transform
from simulation.scenario.c_arm_angles import CArmAngles, c_arm_rotation
from simulation.scenario.frames import Beam
from simulation.scenario.values import Scenario
from simulation.world.mount import yielded_base

To = TypeVar("To", bound=Frame)
From = TypeVar("From", bound=Frame)


@dataclass(frozen=True, slots=True, eq=False)
class Rod:
    """A wire, or the hole that a drill left, in the bone's frame.

    Attributes
    ----------
    hole_id
        The guide hole that it went through.
    axis
        Directed along drilling.
    start_mm, end_mm
        Along the axis, from its point.
    """

    hole_id: str
    axis: Line
    start_mm: float
    end_mm: float
    diameter_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class WorldState:
    """What changes during a case.

    Attributes
    ----------
    platform
        Where the robot's platform stands.
    wires, drilled
        What people put into the bone, and the holes they drilled.
    nail_present, guide_present
        False after somebody took it away (an injected fault).
    ring_shift_mm
        How far the ring slipped along the detector's columns (an injected fault).
    mount_shift_mm
        How far the mount slipped, along the base's x, y and z (an injected fault).
    """

    platform: Transform[RobotBase, RobotTop]
    angles: CArmAngles
    wires: tuple[Rod, ...] = ()
    drilled: tuple[Rod, ...] = ()
    nail_present: bool = True
    guide_present: bool = True
    ring_shift_mm: float = 0.0
    mount_shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Poses of everything in the frame of the beam, and the camera."""

    intrinsic_matrix_px: NDArray[np.float64]
    room_from_beam: Transform[Room, Beam]
    beam_from_bone: Transform[Beam, Bone]
    beam_from_nail: Transform[Beam, Nail]
    beam_from_guide: Transform[Beam, Guide]
    beam_from_ring: Transform[Beam, Ring]
    rotation_deg: float
    state: WorldState = field(repr=False)

    @property
    def guide_from_nail(self) -> Transform[Guide, Nail]:
        """The nail as the guide sees it: what all the estimators are after."""
        return self.beam_from_guide.inverse() @ self.beam_from_nail


def mapped(transform: Transform[To, From], line: Line) -> Line:
    """The same line in another frame."""
    return Line(transform @ line.point_mm, transform.directions(line.direction))


def starting_state(scenario: Scenario) -> WorldState:
    """Robot in its home pose, C-arm as it was pushed in, nothing inserted."""
    hexapod = scenario.parts.hexapod
    angles = CArmAngles(scenario.c_arm.start_orbital_deg, scenario.c_arm.start_angular_deg)
    return WorldState(base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm), angles)


def bone_from_guide(scenario: Scenario, state: WorldState) -> Transform[Bone, Guide]:
    """Where the guide is, as long as nothing pushes it."""
    head = scenario.parts.hexapod.top_from_guide(scenario.head_extension_mm)
    slipped: Transform[RobotBase, RobotBase] = Transform.from_rotvec(np.zeros(3), state.mount_shift_mm)
    held = state.platform @ head
    if scenario.mount_yield is not None:
        hexapod = scenario.parts.hexapod
        at_rest = base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm) @ head
        held = yielded_base(scenario.mount_yield, at_rest, held) @ held
    return scenario.placement.bone_from_base @ slipped @ held


def principal_point_px(scenario: Scenario, angles: CArmAngles) -> NDArray[np.float64]:
    """Principal point in ideal pixels, shape (2,): it wanders as the C-arm bends under its weight."""
    c = scenario.c_arm
    turned = np.array([angles.orbital_deg - c.start_orbital_deg, angles.angular_deg - c.start_angular_deg])
    return np.asarray(0.5 * (c.size_px - 1) + np.array(c.principal_point_px) + turned @ np.array(c.sag_px_per_deg))


def _beam_from_ring(scenario: Scenario, centre_px: NDArray[np.float64], shift_mm: float) -> Transform[Beam, Ring]:
    c = scenario.c_arm
    middle_mm = (0.5 * (c.size_px - 1) - centre_px) * c.pixel_mm
    beam_from_detector = np.eye(4)
    beam_from_detector[:3, 3] = [middle_mm[0] + shift_mm, middle_mm[1], c.source_to_detector_mm]
    return Transform.from_matrix(beam_from_detector @ c.detector_from_ring.matrix)


def world_at(scenario: Scenario, state: WorldState) -> World:
    """Work out every pose for one state of the room."""
    c = scenario.c_arm
    centre = principal_point_px(scenario, state.angles)
    focal = c.source_to_detector_mm / c.pixel_mm
    rotation = c_arm_rotation(state.angles, c.roll_deg)
    room_from_beam: Transform[Room, Beam] = Transform.from_rotation_translation(
        rotation, -c.isocentre_mm * rotation[:, 2]
    )
    beam_from_bone = room_from_beam.inverse() @ scenario.placement.room_from_bone
    turned = np.hypot(state.angles.orbital_deg - c.start_orbital_deg, state.angles.angular_deg - c.start_angular_deg)
    return World(
        intrinsic_matrix_px=np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]]),
        room_from_beam=room_from_beam,
        beam_from_bone=beam_from_bone,
        beam_from_nail=beam_from_bone @ scenario.placement.bone_from_nail,
        beam_from_guide=beam_from_bone @ bone_from_guide(scenario, state),
        beam_from_ring=_beam_from_ring(scenario, centre, state.ring_shift_mm),
        rotation_deg=float(turned),
        state=state,
    )
