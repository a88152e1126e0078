"""What the guard checks of a plan against the robot itself: which robot, where it stands, where it is to go."""

from collections.abc import Iterator

import numpy as np

from services.robot.core.controller_feedback import READ_BACK_TOLERANCE, Deviation, deviation
from services.robot.core.guard_context import GuardContext
from services.robot.core.plans import PlannedMove
from services.robot.core.refusals import Refusal, RefusalCode
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.hexapod_limits import path_violations
from shared.geometry.hexapod_screw import screw_violations

LEG_LENGTH_TOLERANCE_MM = 0.001
TARGET_TOLERANCE = Deviation(0.01, 0.01)
PIVOT_TOLERANCE_MM = 1e-6


def hardware_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the plan is for this robot and this run of its service."""
    if plan.robot_boot_epoch != now.boot_epoch:
        yield Refusal(
            RefusalCode.WRONG_BOOT_EPOCH,
            "the robot service was restarted after the plan's image; take an image and plan again",
        )
    if plan.hexapod_sha256 != now.hexapod.sha256:
        yield Refusal(
            RefusalCode.PLAN_FOR_ANOTHER_ROBOT,
            f"the plan was made with hexapod file {plan.hexapod_sha256[:12]}, this robot is "
            f"{now.hexapod.sha256[:12]}; give registration the file of this robot",
        )
    apart_mm = float(np.abs(plan.pivot_mm - now.hexapod.pivot_mm).max())
    if not apart_mm <= PIVOT_TOLERANCE_MM:
        yield Refusal(
            RefusalCode.PIVOT_MISMATCH,
            f"the plan's pivot {plan.pivot_mm.tolist()} mm is {apart_mm:.3g} mm from this robot's "
            f"{now.hexapod.pivot_mm.tolist()} mm; plan with the pivot of the hexapod file",
        )
    if not now.hexapod.head_extension_mm.contains(plan.head_extension_mm):
        yield Refusal(
            RefusalCode.HEAD_EXTENSION,
            f"the plan's head extension is {plan.head_extension_mm:g} mm, the head can be set from "
            f"{now.hexapod.head_extension_mm.minimum:g} to {now.hexapod.head_extension_mm.maximum:g} mm; "
            "read its scale again and correct the case",
        )


def start_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the robot is ready, and stands where the plan starts."""
    if now.feedback is None:
        yield Refusal(RefusalCode.POSE_UNKNOWN, "the controller has not said where the robot stands; check its cable")
        return
    if not now.feedback.referenced:
        yield Refusal(RefusalCode.NOT_REFERENCED, "the axes are not referenced; ask for reference first")
    if now.feedback.moving or not now.feedback.locked:
        yield Refusal(
            RefusalCode.NOT_LOCKED, "the robot is not locked at rest, as it must be before a move; stop it and look"
        )
    off = deviation(plan.start_pose, now.feedback.pose)
    if off.exceeds(READ_BACK_TOLERANCE):
        yield Refusal(
            RefusalCode.START_POSE_DIFFERS,
            f"the robot stands {off} from where the plan starts, the limits are {READ_BACK_TOLERANCE}; "
            "take an image and plan again",
        )


def target_refusals(plan: PlannedMove, hexapod: HexapodPart) -> Iterator[Refusal]:
    """Whether target and leg lengths follow from the plan's own guide correction, by our own reckoning."""
    if not np.isfinite([plan.start_pose.as_array(), plan.target_pose.as_array()]).all():
        yield Refusal(RefusalCode.TARGET_INCONSISTENT, "the plan's poses are not finite numbers; plan again")
        return
    off = deviation(_target_by_own_reckoning(plan, hexapod), plan.target_pose)
    if off.exceeds(TARGET_TOLERANCE):
        yield Refusal(
            RefusalCode.TARGET_INCONSISTENT,
            f"the plan's target is {off} from where its own guide correction leads, the limits are "
            f"{TARGET_TOLERANCE}; compare the hexapod files and versions of the services",
        )
    lengths = leg_lengths_mm(hexapod, plan.target_pose.as_array(), plan.pivot_mm)
    off_mm = float(np.abs(lengths - plan.target_leg_lengths_mm).max())
    if not off_mm <= LEG_LENGTH_TOLERANCE_MM:
        yield Refusal(
            RefusalCode.LEG_LENGTHS_INCONSISTENT,
            f"the plan's leg lengths differ from this robot's own by {off_mm:.4f} mm (limit "
            f"{LEG_LENGTH_TOLERANCE_MM:g} mm); compare the hexapod files and versions of the services",
        )


def _target_by_own_reckoning(plan: PlannedMove, hexapod: HexapodPart) -> PlatformPose:
    top_from_guide = hexapod.top_from_guide(plan.head_extension_mm)
    base_from_guide = base_from_top(hexapod, plan.start_pose, plan.pivot_mm) @ top_from_guide
    base_from_target_top = base_from_guide @ plan.guide_from_target_guide @ top_from_guide.inverse()
    return platform_pose(hexapod, base_from_target_top, plan.pivot_mm)


def reach_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the move is short enough, and possible all the way."""
    step = deviation(plan.start_pose, plan.target_pose)
    if step.exceeds(now.limits.step):
        yield Refusal(
            RefusalCode.STEP_TOO_LARGE,
            f"the move is {step}, the limits of one move are {now.limits.step}; bring the guide nearer by hand",
        )
    # Straight, as our controllers move, and along the screw, as one would that interpolates in space.
    way = (now.hexapod, plan.start_pose, plan.target_pose, plan.pivot_mm)
    violations = path_violations(*way) or screw_violations(*way)
    if violations:
        yield Refusal(RefusalCode.OUT_OF_REACH, violations[0].message)
