"""The controller's model: what moves, when it may, and how it comes to rest."""

from dataclasses import replace

import numpy as np
import pytest

from shared.geometry.hexapod import PlatformPose
from shared.parts.hexapod_file import default_hexapod
from simulation.controller import hexapod_model as model
from simulation.controller.accuracy import ACCURACY_DEG, ACCURACY_MM, perfect, seeded
from simulation.controller.faults import Fault, with_fault, without_fault
from simulation.controller.gcs_protocol import GcsError, GcsRefusal
from simulation.controller.hexapod_model import Encoders, HexapodState
from simulation.controller.moves import RAMP_S, Purpose

HEXAPOD = default_hexapod()
FAR = np.array([4.0, -2.0, 1.0, 2.0, -1.0, 3.0])


def ready() -> HexapodState:
    state = model.reference(HEXAPOD, model.initial_state(HEXAPOD), Encoders.ABSOLUTE)
    return model.release_brake(model.switch_servo_on(state))


def moving(for_s: float = 0.5) -> HexapodState:
    return model.advance(HEXAPOD, model.command_move(HEXAPOD, ready(), FAR), for_s)


def settled(state: HexapodState) -> HexapodState:
    return model.advance(HEXAPOD, state, 60.0)


def test_power_on_is_locked_unreferenced_and_at_home() -> None:
    state = model.initial_state(HEXAPOD)
    assert state.brake_on
    assert not state.servo_on
    assert not state.referenced
    np.testing.assert_array_equal(state.pose, HEXAPOD.home_pose.as_array())


def test_move_takes_the_time_its_speed_allows_and_ends_at_the_target() -> None:
    target = np.array([4.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    began = model.command_move(HEXAPOD, ready(), target)
    seconds = 4.0 / HEXAPOD.speed_limits.translation_mm_per_s + RAMP_S
    assert model.advance(HEXAPOD, began, seconds - 0.01).move is not None
    ended = model.advance(HEXAPOD, began, seconds + 0.01)
    assert ended.move is None
    assert ended.on_target
    np.testing.assert_array_equal(ended.pose, target)


def test_rotation_keeps_to_its_own_limit_however_slow_the_translation() -> None:
    slow = model.set_velocity(HEXAPOD, ready(), 0.5 * HEXAPOD.speed_limits.translation_mm_per_s)
    began = model.command_move(HEXAPOD, slow, np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0]))
    assert began.move is not None
    assert began.move.profile.duration_s == pytest.approx(2.0 / HEXAPOD.speed_limits.rotation_deg_per_s + RAMP_S)


def test_many_short_steps_are_one_long_step() -> None:
    steps = moving(0.0)
    for _ in range(70):
        steps = model.advance(HEXAPOD, steps, 0.01)
    np.testing.assert_allclose(steps.pose, moving(0.7).pose, atol=1e-12)


@pytest.mark.parametrize("missing", ["servo", "brake", "reference"])
def test_nothing_moves_without_servo_free_brake_and_reference(missing: str) -> None:
    state = {
        "servo": replace(ready(), servo_on=False),
        "brake": replace(ready(), brake_on=True),
        "reference": replace(ready(), referenced=False),
    }[missing]
    with pytest.raises(GcsRefusal, match="NOT_REFERENCED_OR_SERVO_OFF"):
        model.command_move(HEXAPOD, state, FAR)


def test_targets_out_of_the_legs_reach_are_refused() -> None:
    with pytest.raises(GcsRefusal, match="OUT_OF_LIMITS"):
        model.command_move(HEXAPOD, ready(), np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0]))


def test_halt_comes_to_rest_on_the_line_within_the_ramp() -> None:
    state = moving()
    halted = model.halt(state)
    assert halted.error is GcsError.STOPPED
    assert halted.move is not None
    rest = model.advance(HEXAPOD, halted, RAMP_S + 1e-9)
    assert rest.move is None
    np.testing.assert_allclose(rest.target, rest.pose)
    beyond = rest.pose - state.pose
    assert np.linalg.norm(beyond) > 0.0
    np.testing.assert_allclose(beyond / np.linalg.norm(beyond), FAR / np.linalg.norm(FAR), atol=1e-9)


def test_halting_twice_changes_nothing() -> None:
    halted = model.advance(HEXAPOD, model.halt(moving()), 0.5 * RAMP_S)
    np.testing.assert_allclose(settled(model.halt(halted)).pose, settled(halted).pose, atol=1e-12)


def test_stop_is_at_rest_at_once() -> None:
    state = moving()
    stopped = model.stop(state)
    assert stopped.move is None
    assert stopped.error is GcsError.STOPPED
    np.testing.assert_array_equal(stopped.pose, state.pose)
    np.testing.assert_array_equal(settled(stopped).pose, state.pose)


def test_brake_or_servo_off_ends_a_move_where_it_is() -> None:
    for end in (model.apply_brake, model.switch_servo_off):
        ended = end(moving())
        assert ended.move is None
        np.testing.assert_array_equal(settled(ended).pose, moving().pose)


def test_new_target_during_a_move_is_reached_by_way_of_rest() -> None:
    other = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    redirected = model.command_move(HEXAPOD, moving(), other)
    assert redirected.move is not None
    assert redirected.move.purpose is Purpose.STOP
    np.testing.assert_array_equal(settled(redirected).pose, other)


def test_halt_forgets_a_queued_target() -> None:
    other = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    halted = settled(model.halt(model.command_move(HEXAPOD, moving(), other)))
    np.testing.assert_allclose(halted.pose, settled(model.halt(moving())).pose)


def test_absolute_encoders_reference_without_moving() -> None:
    state = model.reference(HEXAPOD, model.initial_state(HEXAPOD), Encoders.ABSOLUTE)
    assert state.referenced
    assert state.move is None


def test_incremental_encoders_reference_by_a_move_home() -> None:
    away = replace(ready(), rest_pose=FAR, target=FAR, referenced=False)
    referencing = model.reference(HEXAPOD, away, Encoders.INCREMENTAL)
    assert referencing.move is not None
    assert not referencing.referenced
    ended = settled(referencing)
    assert ended.referenced
    np.testing.assert_array_equal(ended.pose, HEXAPOD.home_pose.as_array())
    assert not settled(model.stop(referencing)).referenced
    with pytest.raises(GcsRefusal, match="NOT_REFERENCED_OR_SERVO_OFF"):
        model.reference(HEXAPOD, model.apply_brake(away), Encoders.INCREMENTAL)


def test_pivot_may_change_only_while_level() -> None:
    pivot = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(model.set_pivot(ready(), pivot).pivot_mm, pivot)
    tilted = settled(model.command_move(HEXAPOD, ready(), FAR))
    with pytest.raises(GcsRefusal, match="PIVOT_WHILE_ROTATED"):
        model.set_pivot(tilted, pivot)
    assert model.set_pivot(tilted, tilted.pivot_mm) is tilted


def test_velocity_has_limits() -> None:
    for velocity in (0.0, -1.0, 1.001 * HEXAPOD.speed_limits.translation_mm_per_s):
        with pytest.raises(GcsRefusal, match="VELOCITY_OUT_OF_LIMITS"):
            model.set_velocity(HEXAPOD, ready(), velocity)


def test_platform_held_by_nothing_is_remembered() -> None:
    assert not settled(moving()).was_unheld
    dropped = model.switch_servo_off(ready())
    assert dropped.was_unheld
    assert model.apply_brake(dropped).was_unheld


def test_stalled_leg_hangs_then_trips() -> None:
    stalled = with_fault(moving(), Fault.LEG_STALL)
    hanging = model.advance(HEXAPOD, stalled, 0.4)
    assert hanging.move is not None
    np.testing.assert_array_equal(hanging.pose, moving().pose)
    tripped = model.advance(HEXAPOD, hanging, 0.2)
    assert (tripped.servo_on, tripped.brake_on, tripped.error) == (False, True, GcsError.MOTION_ERROR)
    np.testing.assert_array_equal(tripped.pose, moving().pose)


def test_stalled_leg_does_not_matter_at_rest() -> None:
    assert settled(with_fault(ready(), Fault.LEG_STALL)).servo_on


def test_servo_error_brakes_and_keeps_the_servo_off_until_mended() -> None:
    broken = with_fault(moving(), Fault.SERVO_ERROR)
    assert (broken.servo_on, broken.brake_on, broken.error) == (False, True, GcsError.MOTION_ERROR)
    with pytest.raises(GcsRefusal, match="MOTION_ERROR"):
        model.switch_servo_on(broken)
    assert model.switch_servo_on(without_fault(broken, Fault.SERVO_ERROR)).servo_on


def test_emergency_stop_locks_everything_until_released() -> None:
    pressed = with_fault(moving(), Fault.EMERGENCY_STOP)
    assert (pressed.servo_on, pressed.brake_on, pressed.error) == (False, True, GcsError.EMERGENCY_STOP)
    for attempt in (
        model.switch_servo_on,
        model.release_brake,
        lambda state: model.command_move(HEXAPOD, state, FAR),
        lambda state: model.reference(HEXAPOD, state, Encoders.ABSOLUTE),
    ):
        with pytest.raises(GcsRefusal, match="EMERGENCY_STOP"):
            attempt(pressed)
    released = without_fault(pressed, Fault.EMERGENCY_STOP)
    assert not released.servo_on
    assert model.switch_servo_on(released).servo_on


def test_platform_error_is_within_the_accuracy_and_repeatable() -> None:
    seed = 20
    random = np.random.default_rng(seed)
    for _ in range(200):
        measured = PlatformPose.from_array(random.uniform(-8.0, 8.0, 6))
        off = seeded(seed).true_pose(measured).as_array() - measured.as_array()
        assert np.linalg.norm(off[:3]) <= ACCURACY_MM + 1e-12
        assert np.abs(off[3:]).max() <= ACCURACY_DEG + 1e-12
        assert seeded(seed).true_pose(measured) == seeded(seed).true_pose(measured)
        assert perfect().true_pose(measured) == measured
    step = PlatformPose.from_array(1e-3 * np.ones(6))
    origin = PlatformPose.from_array(np.zeros(6))
    difference = seeded(seed).true_pose(step).as_array() - seeded(seed).true_pose(origin).as_array()
    np.testing.assert_allclose(difference, 1e-3 * np.ones(6), atol=2e-4)
