"""The last check before a motion: nothing that others have checked is taken on trust.

Every refusal has its own code, sentence and test. The order matters for people alone: what they can mend soonest
comes first. Whether the motion table allows a move at all is its own business (`motion.py`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

import numpy as np

from services.robot.core.guard_context import GuardContext
from services.robot.core.plan_checks import hardware_refusals, reach_refusals, start_refusals, target_refusals
from services.robot.core.plans import HeardPlan, PlannedMove
from services.robot.core.refusals import Refusal, RefusalCode, refusal
from services.robot.core.tuning import PLAN_TOLERANCES
from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.robot_states import StopButton


@dataclass(frozen=True, slots=True)
class PermittedMove:
    """A move that passed the guard: made by `check_move` alone."""

    plan_sha256: str
    start: PlatformPose
    target: PlatformPose
    speed_mm_per_s: float
    duration_s: float


def check_move(plan_sha256: str, context: GuardContext) -> PermittedMove | Refusal:
    """Let the move of a plan pass, or refuse it with the first reason found. Its permit was checked before."""
    not_now = next(_not_now(context), None)
    if not_now is not None:
        return not_now
    heard = context.registration.heard_plan(plan_sha256)
    if heard is None:
        return refusal(
            RefusalCode.PLAN_UNKNOWN,
            f"registration has not published plan {plan_sha256[:12]} since this service started",
        )
    first = next(_refusals(heard, context), None)
    return _permitted(heard.plan, context.hexapod) if first is None else first


def check_supervision(context: GuardContext) -> Refusal | None:
    """Whether somebody watches over what is about to begin (a move, or reference); None when so."""
    return next(_supervision(context), None)


def _not_now(now: GuardContext) -> Iterator[Refusal]:
    yield from _supervision(now)
    yield from _stop_button(now)


def _refusals(heard: HeardPlan, now: GuardContext) -> Iterator[Refusal]:
    plan = heard.plan
    if plan.sha256 in now.executed:
        yield refusal(
            RefusalCode.PLAN_ALREADY_EXECUTED,
            f"plan {plan.sha256[:12]} was begun before and is carried out at most once",
        )
    yield from _freshness(heard, now)
    yield from hardware_refusals(plan, now)
    yield from start_refusals(plan, now)
    yield from target_refusals(plan, now.hexapod)
    yield from reach_refusals(plan, now)


def _supervision(now: GuardContext) -> Iterator[Refusal]:
    if not now.link_up:
        yield refusal(RefusalCode.LINK_LOST, "the link to the router is lost")
    silent_s = float("inf") if now.heartbeat_s is None else now.now_s - now.heartbeat_s
    if silent_s > now.limits.heartbeat_deadline_s:
        yield refusal(
            RefusalCode.HEARTBEAT_MISSING,
            f"the gateway was last heard {silent_s:.2f} s ago, the limit is {now.limits.heartbeat_deadline_s:g} s",
        )


def _stop_button(now: GuardContext) -> Iterator[Refusal]:
    match now.stop_button:
        case StopButton.PRESSED:
            yield refusal(
                RefusalCode.STOP_BUTTON_PRESSED,
                "the controller's stop button is pressed",
            )
        case StopButton.RELEASED:
            yield refusal(
                RefusalCode.STOP_IN_FORCE,
                "the controller's stop button was pressed and nobody has acknowledged it",
            )
        case StopButton.ABSENT | StopButton.CLEAR:
            return
        case _:
            assert_never(now.stop_button)


def _freshness(heard: HeardPlan, now: GuardContext) -> Iterator[Refusal]:
    plan = heard.plan
    yield from _registration_is_heard(now)
    if plan.registration_epoch != now.registration.epoch:
        newest = now.registration.epoch or "not known"
        yield refusal(
            RefusalCode.PLAN_STALE,
            f"the plan is of registration epoch '{plan.registration_epoch}', the newest is "
            f"'{newest}': a newer image or set-up has replaced it",
        )
    age_s = now.now_s - heard.arrived_s
    if age_s > now.limits.plan_lifetime_s:
        yield refusal(
            RefusalCode.PLAN_EXPIRED,
            f"the plan is {age_s:.0f} s old, the limit is {now.limits.plan_lifetime_s:g} s",
        )
    if heard.arrived_s < now.connected_s:
        yield refusal(
            RefusalCode.PLAN_BEFORE_RECONNECTION,
            "the controller was connected again after this plan was made",
        )
    if now.registration.case != (plan.case_id, plan.case_revision):
        yield refusal(
            RefusalCode.PLAN_OF_ANOTHER_CASE,
            f"the plan is for revision {plan.case_revision} of case '{plan.case_id}', which is not the open one",
        )


def _registration_is_heard(now: GuardContext) -> Iterator[Refusal]:
    silent_s = now.registration.silent_for_s(now.now_s)
    if silent_s > now.limits.registration_deadline_s:
        heard = "has gone" if silent_s == float("inf") else f"was last heard {silent_s:.2f} s ago"
        yield refusal(
            RefusalCode.REGISTRATION_SILENT,
            f"registration {heard} (limit {now.limits.registration_deadline_s:g} s), so a newer image may have arrived",
        )


def _permitted(plan: PlannedMove, hexapod: HexapodPart) -> PermittedMove:
    """Speed at which neither the translation nor the rotation is faster than the robot's limits."""
    travel = np.abs(plan.target_pose.as_array() - plan.start_pose.as_array())
    limits = hexapod.speed_limits
    distance_mm = float(np.linalg.norm(travel[:3]))
    angle_deg = float(np.linalg.norm(travel[3:]))
    duration_s = max(distance_mm / limits.translation_mm_per_s, angle_deg / limits.rotation_deg_per_s)
    speed_mm_per_s = (
        max(distance_mm / duration_s, PLAN_TOLERANCES.slowest_mm_per_s)
        if duration_s > 0.0
        else PLAN_TOLERANCES.slowest_mm_per_s
    )
    return PermittedMove(plan.sha256, plan.start_pose, plan.target_pose, speed_mm_per_s, duration_s)
