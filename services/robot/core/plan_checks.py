"""What the guard checks of a plan against the robot itself: which robot, where it stands, where it is to go."""

from collections.abc import Iterator

import numpy as np

from services.robot.core.deviation import deviation
from services.robot.core.guard_context import GuardContext
from services.robot.core.plans import PlannedMove
from services.robot.core.refusals import Refusal, RefusalCode, refusal
from services.robot.core.tuning import PLAN_TOLERANCES, SUPERVISION
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.hexapod_limits import path_violations
from shared.geometry.hexapod_screw import screw_violations


def hardware_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the plan is for this robot and this run of its service."""
    if plan.robot_boot_epoch != now.boot_epoch:
        yield refusal(
            RefusalCode.WRONG_BOOT_EPOCH,
            "the robot service was restarted after the plan's image",
            "take an image and plan again",
        )
    if plan.hexapod_sha256 != now.hexapod.sha256:
        yield refusal(
            RefusalCode.PLAN_FOR_ANOTHER_ROBOT,
            f"the plan was made with hexapod file {plan.hexapod_sha256[:12]}, this robot is {now.hexapod.sha256[:12]}",
        )
    apart_mm = float(np.abs(plan.pivot_mm - now.hexapod.pivot_mm).max())
    if not apart_mm <= PLAN_TOLERANCES.pivot_mm:
        yield refusal(
            RefusalCode.PIVOT_MISMATCH,
            f"the plan's pivot {plan.pivot_mm.tolist()} mm is {apart_mm:.3g} mm from this robot's "
            f"{now.hexapod.pivot_mm.tolist()} mm",
        )
    if not now.hexapod.head_extension_mm.contains(plan.head_extension_mm):
        yield refusal(
            RefusalCode.HEAD_EXTENSION,
            f"the plan's head extension is {plan.head_extension_mm:g} mm, the head can be set from "
            f"{now.hexapod.head_extension_mm.minimum:g} to {now.hexapod.head_extension_mm.maximum:g} mm",
        )


def start_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the robot is ready, and stands where the plan starts."""
    if now.feedback is None:
        yield refusal(RefusalCode.POSE_UNKNOWN, "the controller has not reported where the robot stands")
        return
    if not now.feedback.referenced:
        yield refusal(RefusalCode.NOT_REFERENCED, "the axes are not referenced")
    if now.feedback.moving or not now.feedback.locked:
        yield refusal(RefusalCode.NOT_LOCKED, "the robot is not locked at rest, as it must be before a move")
    off = deviation(plan.start_pose, now.feedback.pose)
    if off.exceeds(SUPERVISION.read_back):
        yield refusal(
            RefusalCode.START_POSE_DIFFERS,
            f"the robot stands {off} from where the plan starts, the limits are {SUPERVISION.read_back}",
        )


def target_refusals(plan: PlannedMove, hexapod: HexapodPart) -> Iterator[Refusal]:
    """Whether target and leg lengths follow from the plan's own guide correction, as computed here."""
    if not np.isfinite([plan.start_pose.as_array(), plan.target_pose.as_array()]).all():
        yield refusal(RefusalCode.TARGET_INCONSISTENT, "the plan's poses are not finite numbers", "plan again")
        return
    off = deviation(_target_from_guide_correction(plan, hexapod), plan.target_pose)
    if off.exceeds(PLAN_TOLERANCES.target):
        yield refusal(
            RefusalCode.TARGET_INCONSISTENT,
            f"the plan's target is {off} from where its own guide correction leads, the limits are "
            f"{PLAN_TOLERANCES.target}",
        )
    lengths = leg_lengths_mm(hexapod, plan.target_pose.as_array(), plan.pivot_mm)
    off_mm = float(np.abs(lengths - plan.target_leg_lengths_mm).max())
    if not off_mm <= PLAN_TOLERANCES.leg_length_mm:
        yield refusal(
            RefusalCode.LEG_LENGTHS_INCONSISTENT,
            f"the plan's leg lengths differ from this robot's own by {off_mm:.4f} mm (limit "
            f"{PLAN_TOLERANCES.leg_length_mm:g} mm)",
        )


def _target_from_guide_correction(plan: PlannedMove, hexapod: HexapodPart) -> PlatformPose:
    top_from_guide = hexapod.top_from_guide(plan.head_extension_mm)
    base_from_guide = base_from_top(hexapod, plan.start_pose, plan.pivot_mm) @ top_from_guide
    base_from_target_top = base_from_guide @ plan.guide_from_target_guide @ top_from_guide.inverse()
    return platform_pose(hexapod, base_from_target_top, plan.pivot_mm)


def reach_refusals(plan: PlannedMove, now: GuardContext) -> Iterator[Refusal]:
    """Whether the move is short enough, and possible all the way."""
    step = deviation(plan.start_pose, plan.target_pose)
    if step.exceeds(now.limits.step):
        yield refusal(
            RefusalCode.STEP_TOO_LARGE,
            f"the move is {step}, the limits of one move are {now.limits.step}",
        )
    # Straight, as our controllers move, and along the screw, as one would that interpolates in space.
    way = (now.hexapod, plan.start_pose, plan.target_pose, plan.pivot_mm)
    violations = path_violations(*way) or screw_violations(*way)
    if violations:
        yield Refusal(RefusalCode.OUT_OF_REACH, violations[0].message)  # its sentence has a remedy of its own
