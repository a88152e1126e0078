"""Plans and targets for those who stand in for registration."""

import random

import numpy as np

from shared.geometry.frames import Guide
from shared.geometry.hexapod import PlatformPose, base_from_top, leg_lengths_mm
from shared.geometry.hexapod_limits import path_violations
from shared.geometry.hexapod_screw import screw_violations
from shared.geometry.transform import Transform
from shared.messages.geometry import matrix4, vector3
from shared.messages.registration import Plan
from shared.messages.robot import PlatformPoseMessage
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()
EXTENSION_MM = 60.0
NO_SHA = "d" * 64
HOLE_IDS = ("distal",)


def plan_between(
    start: PlatformPose, target: PlatformPose, epoch: str, robot_boot_epoch: str, case: tuple[str, int]
) -> Plan:
    """A plan as registration would make it, for a case of this id and revision."""
    top_from_guide = HEXAPOD.top_from_guide(EXTENSION_MM)
    here = base_from_top(HEXAPOD, start, HEXAPOD.pivot_mm) @ top_from_guide
    there = base_from_top(HEXAPOD, target, HEXAPOD.pivot_mm) @ top_from_guide
    correction: Transform[Guide, Guide] = here.inverse() @ there
    a, b, c, d, e, f = (float(v) for v in leg_lengths_mm(HEXAPOD, target.as_array(), HEXAPOD.pivot_mm))
    return Plan(
        case_id=case[0],
        case_revision=case[1],
        image_sha256=NO_SHA,
        registration_epoch=epoch,
        robot_boot_epoch=robot_boot_epoch,
        hexapod_sha256=HEXAPOD.sha256,
        hole_ids=HOLE_IDS,
        head_extension_mm=EXTENSION_MM,
        guide_from_target_guide=matrix4(correction),
        start_pose=PlatformPoseMessage.of(start),
        target_pose=PlatformPoseMessage.of(target),
        pivot_mm=vector3(HEXAPOD.pivot_mm),
        target_leg_lengths_mm=(a, b, c, d, e, f),
        travel_mm=float(np.linalg.norm(target.as_array()[:3] - start.as_array()[:3])),
        travel_deg=0.0,
        axial_shift_mm=0.0,
        predicted=(),
    )


def random_target(source: random.Random, size: float) -> PlatformPose:
    """A pose within `size` (mm and degrees) of the middle on every axis, to a micrometre as people would give it."""
    return PlatformPose(*(round(source.uniform(-size, size), 3) for _ in range(6)))


def reachable_target(source: random.Random, start: PlatformPose, size: float) -> PlatformPose:
    """A random target to which the robot can go, straight and along the screw, as its service demands."""
    while True:
        target = random_target(source, size)
        way = (HEXAPOD, start, target, HEXAPOD.pivot_mm)
        if not (path_violations(*way) or screw_violations(*way)):
            return target
