"""The last check before a motion: nothing that others have checked is taken on trust.

Every refusal has its own code, sentence and test. The order matters for people alone: what they can mend soonest
comes first. Whether the motion table allows a move at all is its own business (`motion.py`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from services.robot.core.plans import PlannedMove, RegistrationView
from services.robot.core.readings import READ_BACK_TOLERANCE, ControllerReading, Deviation, deviation
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.stop_button import StopButton
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.hexapod_limits import path_violations
from shared.geometry.hexapod_screw import screw_violations

LEG_LENGTH_TOLERANCE_MM = 0.001
TARGET_TOLERANCE = Deviation(0.01, 0.01)
PIVOT_TOLERANCE_MM = 1e-6
SLOWEST_MM_PER_S = 0.01


@dataclass(frozen=True, slots=True)
class GuardLimits:
    """What a single move may be, and how old what it rests on.

    Attributes
    ----------
    step
        Greatest move: the pivot's displacement and the angle of rotation.
    plan_lifetime_s
        Longest time from the arrival of a plan to its execution.
    heartbeat_deadline_s
        Longest silence of the gateway, before and during a move.
    registration_deadline_s
        Longest silence of registration before a move: nobody else knows whether a newer image has arrived.
    """

    step: Deviation
    plan_lifetime_s: float
    heartbeat_deadline_s: float
    registration_deadline_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """All that the robot service knows at the moment of decision.

    Attributes
    ----------
    now_s, heartbeat_s, connected_s
        Own monotonic clock: now, when the gateway was last heard, when the controller was connected.
    executed
        Hashes of the plans that were begun.
    """

    boot_epoch: str
    now_s: float
    hexapod: HexapodPart
    limits: GuardLimits
    registration: RegistrationView
    reading: ControllerReading | None
    connected_s: float
    heartbeat_s: float | None
    link_up: bool
    executed: frozenset[str]
    stop_button: StopButton = StopButton.CLEAR


@dataclass(frozen=True, slots=True)
class PermittedMove:
    """A move that passed the guard: made by `check_move` alone."""

    plan_sha256: str
    start: PlatformPose
    target: PlatformPose
    speed_mm_per_s: float
    duration_s: float


def check_move(plan: PlannedMove, approved_sha256: str, situation: Situation) -> PermittedMove | Refusal:
    """Let a move pass, or refuse it with the first reason found."""
    for refusal in _refusals(plan, approved_sha256, situation):
        return refusal
    return _permitted(plan, situation.hexapod)


def check_supervision(situation: Situation) -> Refusal | None:
    """Whether somebody watches over what is about to begin (a move, or reference); None when so."""
    return next(_supervision(situation), None)


def _refusals(plan: PlannedMove, approved_sha256: str, now: Situation) -> Iterator[Refusal]:
    yield from _supervision(now)
    yield from _stop_button(now)
    yield from _approval(plan, approved_sha256, now)
    yield from _freshness(plan, now)
    yield from _hardware(plan, now)
    yield from _start(plan, now)
    yield from _target(plan, now.hexapod)
    yield from _reach(plan, now)


def _supervision(now: Situation) -> Iterator[Refusal]:
    if not now.link_up:
        yield Refusal(RefusalCode.LINK_LOST, "the link to the router is lost; nothing moves until it is back")
    silent_s = float("inf") if now.heartbeat_s is None else now.now_s - now.heartbeat_s
    if silent_s > now.limits.heartbeat_deadline_s:
        yield Refusal(
            RefusalCode.HEARTBEAT_MISSING,
            f"the gateway was last heard {silent_s:.2f} s ago, the limit is {now.limits.heartbeat_deadline_s:g} s; "
            "see that it runs and ask again",
        )


def _stop_button(now: Situation) -> Iterator[Refusal]:
    match now.stop_button:
        case StopButton.PRESSED:
            yield Refusal(
                RefusalCode.STOP_BUTTON_PRESSED,
                "the controller's stop button is pressed; find out why, release it, then acknowledge the stop",
            )
        case StopButton.RELEASED:
            yield Refusal(
                RefusalCode.STOP_IN_FORCE,
                "the controller's stop button was pressed and nobody has acknowledged it; find out why, then do",
            )
        case StopButton.ABSENT | StopButton.CLEAR:
            return
        case _:
            assert_never(now.stop_button)


def _approval(plan: PlannedMove, approved_sha256: str, now: Situation) -> Iterator[Refusal]:
    if plan.sha256 != approved_sha256:
        yield Refusal(
            RefusalCode.APPROVAL_MISMATCH,
            f"the approval is for plan {approved_sha256[:12]}, the move asked for is plan {plan.sha256[:12]}; "
            "approve the plan that is to be carried out",
        )
    if now.registration.arrival_s(plan.sha256) is None:
        yield Refusal(
            RefusalCode.PLAN_UNKNOWN,
            f"registration has not published plan {plan.sha256[:12]} since this service started; make a new plan",
        )
    if plan.sha256 in now.executed:
        yield Refusal(
            RefusalCode.PLAN_ALREADY_EXECUTED,
            f"plan {plan.sha256[:12]} was begun before and is carried out at most once; take an image and plan again",
        )


def _freshness(plan: PlannedMove, now: Situation) -> Iterator[Refusal]:
    yield from _vouched(now)
    if plan.registration_epoch != now.registration.epoch:
        newest = now.registration.epoch or "not known"
        yield Refusal(
            RefusalCode.PLAN_STALE,
            f"the plan is of registration epoch '{plan.registration_epoch}', the newest is "
            f"'{newest}': a newer image or set-up has replaced it; plan from the newest image",
        )
    arrival_s = now.registration.arrival_s(plan.sha256)
    age_s = now.now_s - (now.now_s if arrival_s is None else arrival_s)
    if age_s > now.limits.plan_lifetime_s:
        yield Refusal(
            RefusalCode.PLAN_EXPIRED,
            f"the plan is {age_s:.0f} s old, the limit is {now.limits.plan_lifetime_s:g} s; "
            "take an image and plan again",
        )
    if arrival_s is not None and arrival_s < now.connected_s:
        yield Refusal(
            RefusalCode.PLAN_BEFORE_RECONNECTION,
            "the controller was connected again after this plan was made; take an image and plan again",
        )
    if now.registration.case != (plan.case_id, plan.case_revision):
        yield Refusal(
            RefusalCode.PLAN_OF_ANOTHER_CASE,
            f"the plan is for revision {plan.case_revision} of case '{plan.case_id}', which is not the open one; "
            "take an image and plan again",
        )


def _vouched(now: Situation) -> Iterator[Refusal]:
    silent_s = now.registration.silent_for_s(now.now_s)
    if silent_s > now.limits.registration_deadline_s:
        heard = "has gone" if silent_s == float("inf") else f"was last heard {silent_s:.2f} s ago"
        yield Refusal(
            RefusalCode.REGISTRATION_SILENT,
            f"registration {heard} (limit {now.limits.registration_deadline_s:g} s), so nobody vouches that no newer "
            "image has arrived; see that it runs and ask again",
        )


def _hardware(plan: PlannedMove, now: Situation) -> Iterator[Refusal]:
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


def _start(plan: PlannedMove, now: Situation) -> Iterator[Refusal]:
    if now.reading is None:
        yield Refusal(RefusalCode.POSE_UNKNOWN, "the controller has not said where the robot stands; check its cable")
        return
    if not now.reading.referenced:
        yield Refusal(RefusalCode.NOT_REFERENCED, "the axes are not referenced; ask for reference first")
    if now.reading.moving or not now.reading.locked:
        yield Refusal(
            RefusalCode.NOT_LOCKED, "the robot is not locked at rest, as it must be before a move; stop it and look"
        )
    off = deviation(plan.start_pose, now.reading.pose)
    if off.exceeds(READ_BACK_TOLERANCE):
        yield Refusal(
            RefusalCode.START_POSE_DIFFERS,
            f"the robot stands {off} from where the plan starts, the limits are {READ_BACK_TOLERANCE}; "
            "take an image and plan again",
        )


def _target(plan: PlannedMove, hexapod: HexapodPart) -> Iterator[Refusal]:
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


def _reach(plan: PlannedMove, now: Situation) -> Iterator[Refusal]:
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


def _permitted(plan: PlannedMove, hexapod: HexapodPart) -> PermittedMove:
    """Speed at which neither the translation nor the rotation is faster than the robot's limits."""
    travel = np.abs(plan.target_pose.as_array() - plan.start_pose.as_array())
    limits = hexapod.speed_limits
    distance_mm = float(np.linalg.norm(travel[:3]))
    angle_deg = float(np.linalg.norm(travel[3:]))
    duration_s = max(distance_mm / limits.translation_mm_per_s, angle_deg / limits.rotation_deg_per_s)
    speed_mm_per_s = max(distance_mm / duration_s, SLOWEST_MM_PER_S) if duration_s > 0.0 else SLOWEST_MM_PER_S
    return PermittedMove(plan.sha256, plan.start_pose, plan.target_pose, speed_mm_per_s, duration_s)
