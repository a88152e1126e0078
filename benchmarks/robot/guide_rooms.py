"""Rooms for the guide calibration: a head made otherwise than its file says, seen in numbers or in rendered images."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.scenes.random_scenes import nominal_of
from distalock.guide_calibration.hand_eye import GuideView, moved
from distalock.guide_calibration.noise import image_covariance
from distalock.robot_guide_images import Seen, observe_guide
from shared.geometry.frames import Guide, Ring, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.transform import Transform
from simulation.controller.accuracy import seeded
from simulation.render.image import render_scene
from simulation.scenario.sampling import scenario_of_seed
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state, world_at

EXTENSION_MM = 60.0
MADE_SD_MM, MADE_SD_DEG = 0.7, 0.7

Head = Transform[RobotTop, Guide]


@dataclass(frozen=True, slots=True, eq=False)
class RoomImage:
    """One image of a room, with where the guide really is."""

    pixels: NDArray[np.float32]
    pose: PlatformPose
    ring_from_guide: Transform[Ring, Guide]


def made_head(hexapod: HexapodPart, seed: int) -> Head:
    """A head as it was really made: off its file by some tenths of a millimetre and degree."""
    rng = np.random.default_rng([seed, 9])
    off: Transform[Guide, Guide] = Transform.from_rotvec(
        np.radians(MADE_SD_DEG) * rng.normal(size=3), MADE_SD_MM * rng.normal(size=3)
    )
    return hexapod.top_from_guide(EXTENSION_MM) @ off


def numerical_views(hexapod: HexapodPart, head: Head, poses: Sequence[PlatformPose], seed: int) -> list[GuideView]:
    """Views of a guide that is held so, by a robot with its own inaccuracy, with errors as images have them."""
    rng = np.random.default_rng([seed, 10])
    world = RigidTransform.from_components(
        rng.normal(scale=30.0, size=3) - np.array([0.0, 0.0, 330.0]),
        Rotation.from_rotvec(rng.normal(scale=0.2, size=3)),
    )
    error = seeded(seed)
    views = []
    for pose in poses:
        platform = base_from_top(hexapod, error.true_pose(pose), hexapod.pivot_mm).rigid
        true = world * platform * head.rigid
        covariance = image_covariance(true.rotation.as_matrix())
        seen = moved(true, np.linalg.cholesky(covariance) @ rng.normal(size=6))
        views.append(GuideView(pose, np.asarray(seen.as_matrix()), covariance))
    return views


def rendered_images(hexapod: HexapodPart, head: Head, poses: Sequence[PlatformPose], seed: int) -> Iterator[RoomImage]:
    """Images of a room without a nail, with a robot that has its own inaccuracy."""
    scenario = room_with_head(hexapod, head, seed)
    error = seeded(seed)
    for shot, pose in enumerate(poses):
        platform = base_from_top(hexapod, error.true_pose(pose), hexapod.pivot_mm)
        state = replace(starting_state(scenario), platform=platform, nail_present=False)
        world = world_at(scenario, state)
        pixels = render_scene(scenario, state, shot).pixels.astype(np.float32)
        yield RoomImage(pixels, pose, world.beam_from_ring.inverse() @ world.beam_from_guide)


def room_with_head(hexapod: HexapodPart, head: Head, seed: int) -> Scenario:
    """The seed's room with this head on the robot, and a base mounted so that the guide is where it was."""
    scenario = scenario_of_seed(seed)
    parts, placement = scenario.parts, scenario.placement
    retracted = Transform[RobotTop, Guide].from_rotation_translation(
        head.rotation, head.translation_mm - np.array([EXTENSION_MM, 0.0, 0.0])
    )
    home = base_from_top(hexapod, hexapod.home_pose, hexapod.pivot_mm)
    bone_from_guide = placement.bone_from_base @ home @ parts.hexapod.top_from_guide(scenario.head_extension_mm)
    return replace(
        scenario,
        head_extension_mm=EXTENSION_MM,
        parts=replace(parts, hexapod=replace(hexapod, top_from_guide_retracted=retracted)),
        placement=replace(placement, bone_from_base=bone_from_guide @ (home @ head).inverse()),
    )


def seen_in(image: RoomImage, scenario: Scenario) -> Seen:
    """What the product says of the guide in an image."""
    known = scenario.parts
    return observe_guide(image.pixels, known.ring, known.guide, nominal_of(scenario), image.pose)
