"""The guard: one move that passes, and every way in which it must not."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from services.robot.core import guard
from services.robot.core.controller_feedback import ControllerFeedback
from services.robot.core.deviation import Deviation
from services.robot.core.guard import PermittedMove, check_move, check_supervision
from services.robot.core.guard_context import GuardContext, GuardLimits
from services.robot.core.plans import REMEMBERED_PLANS, EpochReport, HeardPlan, PlannedMove, RegistrationView
from services.robot.core.refusals import Refusal, RefusalCode
from shared.geometry.frames import Guide
from shared.geometry.hexapod import (
    ZERO_POSE,
    HexapodPart,
    PlatformPose,
    base_from_top,
    leg_lengths_mm,
    platform_pose,
)
from shared.geometry.hexapod_limits import within_limits
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod
from shared.robot_states import StopButton

HEXAPOD = default_hexapod()
NOW_S = 1000.0
SHA = "a" * 64


def planned(
    rotation_vector_deg: tuple[float, float, float] = (2.0, -1.0, 3.0),
    translation_mm: tuple[float, float, float] = (3.0, -2.0, 1.0),
    start: PlatformPose = ZERO_POSE,
) -> PlannedMove:
    """A plan as registration would make it, head at 70 mm."""
    correction: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(rotation_vector_deg), translation_mm)
    top_from_guide = HEXAPOD.top_from_guide(70.0)
    moved = base_from_top(HEXAPOD, start, HEXAPOD.pivot_mm) @ top_from_guide @ correction @ top_from_guide.inverse()
    target = platform_pose(HEXAPOD, moved, HEXAPOD.pivot_mm)
    return PlannedMove(
        sha256=SHA,
        hole_ids=("distal",),
        case_id="case1",
        case_revision=2,
        registration_epoch="reg.5",
        robot_boot_epoch="boot",
        hexapod_sha256=HEXAPOD.sha256,
        head_extension_mm=70.0,
        guide_from_target_guide=correction,
        start_pose=start,
        target_pose=target,
        pivot_mm=HEXAPOD.pivot_mm,
        target_leg_lengths_mm=leg_lengths_mm(HEXAPOD, target.as_array(), HEXAPOD.pivot_mm),
    )


READING = ControllerFeedback(
    pose=ZERO_POSE, moving=False, on_target=True, locked=True, unlocked=False, referenced=True, error=None
)
CONTEXT = GuardContext(
    boot_epoch="boot",
    now_s=NOW_S,
    hexapod=HEXAPOD,
    limits=GuardLimits(Deviation(20.0, 12.0), 600.0, 0.2, 1.0),
    registration=RegistrationView(
        EpochReport("reg", 7, "reg.5", NOW_S - 0.2), case=("case1", 2), plans=(HeardPlan(planned(), NOW_S - 60.0),)
    ),
    feedback=READING,
    connected_s=NOW_S - 3600.0,
    heartbeat_s=NOW_S - 0.05,
    link_up=True,
    executed=frozenset(),
)


def with_epoch_report(epoch: str, heard_s: float) -> GuardContext:
    return replace(CONTEXT, registration=CONTEXT.registration.with_epoch_report(EpochReport("reg", 8, epoch, heard_s)))


def with_feedback(**changes: object) -> GuardContext:
    return replace(CONTEXT, feedback=replace(READING, **changes))  # type: ignore[arg-type]


def checked(plan: PlannedMove, context: GuardContext) -> PermittedMove | Refusal:
    """The guard's answer when this is the plan that registration published."""
    plans = tuple(replace(heard, plan=plan) for heard in context.registration.plans)
    return check_move(SHA, replace(context, registration=replace(context.registration, plans=plans)))


def test_a_move_that_is_right_in_every_way_passes() -> None:
    outcome = checked(planned(), CONTEXT)
    assert isinstance(outcome, PermittedMove)
    assert outcome.start == ZERO_POSE
    assert outcome.target == planned().target_pose


def test_a_robot_without_a_stop_button_moves() -> None:
    assert isinstance(checked(planned(), replace(CONTEXT, stop_button=StopButton.ABSENT)), PermittedMove)


def test_a_plan_of_another_hash_is_not_the_one_that_is_asked_for() -> None:
    outcome = check_move("b" * 64, CONTEXT)
    assert isinstance(outcome, Refusal)
    assert outcome.code is RefusalCode.PLAN_UNKNOWN


def test_the_newest_plans_are_kept_and_one_that_comes_again_is_no_younger() -> None:
    view = RegistrationView()
    for number in range(REMEMBERED_PLANS + 1):
        view = view.with_plan(replace(planned(), sha256=f"{number:064x}"), float(number))
    assert view.heard_plan(f"{0:064x}") is None
    oldest = view.with_plan(replace(planned(), sha256=f"{1:064x}"), NOW_S).heard_plan(f"{1:064x}")
    assert oldest is not None
    assert oldest.arrived_s == 1.0


def test_every_refusal_of_the_guard_has_a_test_here() -> None:
    asked_for_here = set(re.findall(r"RefusalCode\.([A-Z_]+)", Path(__file__).read_text()))
    guards_own = set(re.findall(r"RefusalCode\.([A-Z_]+)", Path(guard.__file__).read_text()))
    assert guards_own <= asked_for_here


@pytest.mark.requirement("ROB-09")
def test_the_speed_keeps_to_both_limits_of_the_hexapod_file() -> None:
    for rotation, translation in [((0.0, 0.0, 0.0), (4.0, 0.0, 0.0)), ((0.0, 0.0, 6.0), (0.1, 0.0, 0.0))]:
        plan = planned(rotation, translation)
        outcome = checked(plan, CONTEXT)
        assert isinstance(outcome, PermittedMove)
        travel = np.abs(plan.target_pose.as_array())
        assert outcome.speed_mm_per_s <= HEXAPOD.speed_limits.translation_mm_per_s + 1e-12
        assert outcome.duration_s >= np.linalg.norm(travel[3:]) / HEXAPOD.speed_limits.rotation_deg_per_s - 1e-9
        assert outcome.duration_s == pytest.approx(np.linalg.norm(travel[:3]) / outcome.speed_mm_per_s)


def test_duration_and_speed_of_moves_that_translation_or_rotation_limits() -> None:
    limits = HEXAPOD.speed_limits
    cases = [
        (PlatformPose(0.0, 0.0, 8.0, 1.0, 0.0, 0.0), 8.0 / limits.translation_mm_per_s),
        (PlatformPose(0.0, 0.0, 0.5, 0.0, 0.0, 0.0), 0.5 / limits.translation_mm_per_s),
        (PlatformPose(0.0, 0.0, 0.5, 9.0, 0.0, 0.0), 9.0 / limits.rotation_deg_per_s),
    ]
    start = PlatformPose(0.0, 0.0, -2.0, 0.5, 0.0, 0.0)
    for travel, duration_s in cases:
        target = PlatformPose.from_array(start.as_array() + travel.as_array())
        move = guard._permitted(replace(planned(), start_pose=start, target_pose=target), HEXAPOD)
        assert move.duration_s == pytest.approx(duration_s)
        assert move.speed_mm_per_s == pytest.approx(travel.z_mm / duration_s)
        assert (move.plan_sha256, move.start, move.target) == (SHA, start, target)


def test_supervision_alone_is_checked_before_reference() -> None:
    assert check_supervision(CONTEXT) is None
    refused = check_supervision(replace(CONTEXT, link_up=False))
    assert refused is not None
    assert refused.code is RefusalCode.LINK_LOST
    silent = check_supervision(replace(CONTEXT, heartbeat_s=None))
    assert silent is not None
    assert silent.code is RefusalCode.HEARTBEAT_MISSING


def test_times_exactly_at_their_limits_pass() -> None:
    now_s = 1024.0
    limits = GuardLimits(Deviation(20.0, 12.0), 512.0, 0.25, 1.0)
    registration = RegistrationView(
        EpochReport("reg", 7, "reg.5", now_s - 1.0), case=("case1", 2), plans=(HeardPlan(planned(), now_s - 512.0),)
    )
    context = replace(
        CONTEXT,
        now_s=now_s,
        limits=limits,
        registration=registration,
        heartbeat_s=now_s - 0.25,
        connected_s=now_s - 512.0,
    )
    assert isinstance(checked(planned(), context), PermittedMove)


@pytest.mark.parametrize(("apart_mm", "code"), [(1e-6, None), (2e-6, RefusalCode.PIVOT_MISMATCH)])
def test_a_pivot_may_differ_by_rounding(apart_mm: float, code: RefusalCode | None) -> None:
    plan = replace(planned(), pivot_mm=HEXAPOD.pivot_mm + np.array([0.0, apart_mm, 0.0]))
    outcome = checked(plan, CONTEXT)
    assert (outcome.code if isinstance(outcome, Refusal) else None) is code


def test_a_move_to_where_it_stands_has_a_speed() -> None:
    outcome = checked(planned((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), CONTEXT)
    assert isinstance(outcome, PermittedMove)
    assert outcome.speed_mm_per_s > 0.0


@pytest.mark.requirement("ROB-18")
@pytest.mark.parametrize(
    ("context", "code", "words"),
    [
        (replace(CONTEXT, link_up=False), RefusalCode.LINK_LOST, "link to the router is lost"),
        (replace(CONTEXT, heartbeat_s=None), RefusalCode.HEARTBEAT_MISSING, "last heard inf s ago"),
        (
            replace(CONTEXT, heartbeat_s=NOW_S - 0.3),
            RefusalCode.HEARTBEAT_MISSING,
            "0.30 s ago, the limit is 0.2 s",
        ),
        (
            replace(CONTEXT, registration=replace(CONTEXT.registration, plans=())),
            RefusalCode.PLAN_UNKNOWN,
            "has not published plan aaaaaaaaaaaa",
        ),
        (replace(CONTEXT, executed=frozenset({SHA})), RefusalCode.PLAN_ALREADY_EXECUTED, "at most once"),
        (with_epoch_report("reg.6", NOW_S - 0.1), RefusalCode.PLAN_STALE, "epoch 'reg.5', the newest is 'reg.6'"),
        (
            with_epoch_report("reg.5", NOW_S - 1.1),
            RefusalCode.REGISTRATION_SILENT,
            "last heard 1.10 s ago (limit 1 s)",
        ),
        (
            replace(CONTEXT, registration=CONTEXT.registration.without_epoch()),
            RefusalCode.REGISTRATION_SILENT,
            "has gone",
        ),
        (
            replace(CONTEXT, registration=replace(CONTEXT.registration, newest=None)),
            RefusalCode.REGISTRATION_SILENT,
            "has gone",
        ),
        (
            replace(CONTEXT, registration=replace(CONTEXT.registration, case=None)),
            RefusalCode.PLAN_OF_ANOTHER_CASE,
            "not the open one",
        ),
        (
            replace(with_epoch_report("reg.5", NOW_S + 600.0), now_s=NOW_S + 600.0, heartbeat_s=NOW_S + 600.0),
            RefusalCode.PLAN_EXPIRED,
            "660 s old",
        ),
        (replace(CONTEXT, connected_s=NOW_S - 1.0), RefusalCode.PLAN_BEFORE_RECONNECTION, "connected again"),
        (
            replace(CONTEXT, registration=CONTEXT.registration.with_case("case2", 2, ())),
            RefusalCode.PLAN_OF_ANOTHER_CASE,
            "revision 2 of case 'case1'",
        ),
        (
            replace(CONTEXT, registration=CONTEXT.registration.with_case("case1", 3, ())),
            RefusalCode.PLAN_OF_ANOTHER_CASE,
            "not the open one",
        ),
        (replace(CONTEXT, boot_epoch="later"), RefusalCode.WRONG_BOOT_EPOCH, "was restarted"),
        (
            replace(CONTEXT, stop_button=StopButton.PRESSED),
            RefusalCode.STOP_BUTTON_PRESSED,
            "stop button is pressed; find out why",
        ),
        (
            replace(CONTEXT, stop_button=StopButton.RELEASED),
            RefusalCode.STOP_IN_FORCE,
            "nobody has acknowledged it",
        ),
        (replace(CONTEXT, feedback=None), RefusalCode.POSE_UNKNOWN, "has not reported where"),
        (with_feedback(referenced=False), RefusalCode.NOT_REFERENCED, "not referenced"),
        (with_feedback(locked=False), RefusalCode.NOT_LOCKED, "not locked at rest"),
        (with_feedback(moving=True), RefusalCode.NOT_LOCKED, "not locked at rest"),
        (
            with_feedback(pose=PlatformPose(0.06, 0.0, 0.0, 0.0, 0.0, 0.0)),
            RefusalCode.START_POSE_DIFFERS,
            "stands 0.060 mm and 0.000° from where the plan starts",
        ),
        (
            with_feedback(pose=PlatformPose(0.0, 0.0, 0.0, 0.0, 0.06, 0.0)),
            RefusalCode.START_POSE_DIFFERS,
            "0.060° from where the plan starts",
        ),
        (
            with_feedback(pose=PlatformPose(float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0)),
            RefusalCode.START_POSE_DIFFERS,
            "take an image and plan again",
        ),
    ],
)
def test_contexts_that_refuse_a_good_plan(context: GuardContext, code: RefusalCode, words: str) -> None:
    outcome = checked(planned(), context)
    assert isinstance(outcome, Refusal)
    assert outcome.code is code
    assert words in outcome.message


@pytest.mark.requirement("ROB-18")
@pytest.mark.parametrize(
    ("spoil", "code", "words"),
    [
        (lambda p: replace(p, registration_epoch="reg.4"), RefusalCode.PLAN_STALE, "epoch 'reg.4'"),
        (lambda p: replace(p, robot_boot_epoch="other"), RefusalCode.WRONG_BOOT_EPOCH, "restarted"),
        (lambda p: replace(p, hexapod_sha256="c" * 64), RefusalCode.PLAN_FOR_ANOTHER_ROBOT, "cccccccccccc"),
        (lambda p: replace(p, pivot_mm=np.array([60.0, 0.0, 21.0])), RefusalCode.PIVOT_MISMATCH, "1 mm from this"),
        (lambda p: replace(p, head_extension_mm=81.0), RefusalCode.HEAD_EXTENSION, "from 40 to 80 mm"),
        (lambda p: replace(p, head_extension_mm=60.0), RefusalCode.TARGET_INCONSISTENT, "own guide correction"),
        (
            lambda p: replace(p, target_pose=replace(p.target_pose, x_mm=p.target_pose.x_mm + 0.02)),
            RefusalCode.TARGET_INCONSISTENT,
            "the plan's target is 0.020 mm",
        ),
        (
            lambda p: replace(p, target_pose=replace(p.target_pose, w_deg=float("nan"))),
            RefusalCode.TARGET_INCONSISTENT,
            "not finite",
        ),
        (
            lambda p: replace(p, target_leg_lengths_mm=p.target_leg_lengths_mm + 0.01),
            RefusalCode.LEG_LENGTHS_INCONSISTENT,
            "by 0.0100 mm",
        ),
    ],
)
def test_plans_that_are_refused(spoil: Callable[[PlannedMove], PlannedMove], code: RefusalCode, words: str) -> None:
    outcome = checked(spoil(planned()), CONTEXT)
    assert isinstance(outcome, Refusal)
    assert outcome.code is code
    assert words in outcome.message


@pytest.mark.requirement("ROB-09")
def test_a_step_that_is_too_large_is_refused() -> None:
    outcome = checked(planned((0.0, 0.0, 0.0), (20.5, 0.0, 0.0)), CONTEXT)
    assert isinstance(outcome, Refusal)
    assert outcome.code is RefusalCode.STEP_TOO_LARGE
    turned = checked(planned((0.0, 0.0, 12.5), (0.0, 0.0, 0.0)), CONTEXT)
    assert isinstance(turned, Refusal)
    assert turned.code is RefusalCode.STEP_TOO_LARGE


@pytest.mark.requirement("ROB-09")
def test_a_target_out_of_reach_is_refused_with_the_leg() -> None:
    outcome = checked(planned((0.0, 0.0, 0.0), (0.0, 0.0, 10.0)), CONTEXT)
    assert isinstance(outcome, Refusal)
    assert outcome.code is RefusalCode.OUT_OF_REACH
    assert "leg 1 would be 35.46 mm long" in outcome.message


@pytest.mark.requirement("ROB-09")
@pytest.mark.parametrize("seed", [3])
def test_limits_hold_along_the_way_and_not_only_at_its_end(seed: int) -> None:
    start, shift_mm, narrow = _move_whose_ends_are_allowed_and_whose_middle_is_not(seed)
    # The guide's z axis is the top's -z, its y the top's -y.
    correction: Transform[Guide, Guide] = Transform.from_rotvec([0.0, 0.0, 0.0], shift_mm * [1.0, -1.0, -1.0])
    end = PlatformPose.from_array(start.as_array() + np.concatenate([shift_mm, np.zeros(3)]))
    plan = replace(
        planned(),
        start_pose=start,
        target_pose=end,
        guide_from_target_guide=correction,
        target_leg_lengths_mm=leg_lengths_mm(narrow, end.as_array(), narrow.pivot_mm),
    )
    outcome = checked(plan, replace(with_feedback(pose=start), hexapod=narrow))
    assert isinstance(outcome, Refusal)
    assert outcome.code is RefusalCode.OUT_OF_REACH
    assert outcome.message.startswith("after ")


def _move_whose_ends_are_allowed_and_whose_middle_is_not(
    seed: int,
) -> tuple[PlatformPose, NDArray[np.float64], HexapodPart]:
    """A leg that swings past its upright is shortest in the middle: give the robot legs that may not be so short."""
    rng = np.random.default_rng(seed)
    for _ in range(1000):
        start, end = rng.uniform(-7.0, 7.0, (2, 3))
        poses = np.linspace([*start, 0.0, 0.0, 0.0], [*end, 0.0, 0.0, 0.0], 41)
        lengths = leg_lengths_mm(HEXAPOD, poses, HEXAPOD.pivot_mm)
        shortest_at_ends = lengths[[0, -1]].min()
        if lengths.min() < shortest_at_ends - 0.05 and within_limits(HEXAPOD, poses, HEXAPOD.pivot_mm).all():
            legs = replace(HEXAPOD.leg_length_mm, minimum=float(shortest_at_ends))
            return PlatformPose.from_array(poses[0]), end - start, replace(HEXAPOD, leg_length_mm=legs)
    pytest.fail("no such move found: choose another seed")
