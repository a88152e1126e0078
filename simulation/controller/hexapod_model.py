"""What the controller knows and does, without clock or wire: a state, the operations on it, and `advance` by a time.

All six axes move together on a straight line in X Y Z U V W. Servo and brake act on the whole platform. Motion needs
servo on, brake off and a reference; whatever ends one of these during a move ends the move where it is.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.hexapod_limits import path_violations
from simulation.controller.gcs_protocol import GcsError, GcsRefusal
from simulation.controller.moves import Move, Purpose, Vector, move_between, stopping

STALL_TRIP_S = 0.5
SLIP_MM = 0.3


class Encoders(StrEnum):
    """Absolute encoders know the pose at once; incremental ones must drive to their reference."""

    ABSOLUTE = "absolute"
    INCREMENTAL = "incremental"


@dataclass(frozen=True, slots=True, eq=False)
class HexapodState:
    """State of controller and platform.

    Attributes
    ----------
    rest_pose
        Pose when nothing moves, X Y Z (mm) U V W (degrees), shape (6,).
    target
        Last commanded pose, shape (6,).
    queued
        Target that was commanded during a move: the platform first comes to rest, then goes there.
    pivot_mm
        R S T, shape (3,).
    was_unheld
        Whether the platform was ever held by neither servo nor brake.
    encoder_jump_mm
        What the encoders report too much in X.
    brake_slips, has_slipped
        Whether the brake alone holds badly, and whether the platform has sunk because of that.
    """

    rest_pose: Vector
    target: Vector
    pivot_mm: Vector
    velocity_mm_per_s: float
    servo_on: bool = False
    brake_on: bool = True
    referenced: bool = False
    move: Move | None = None
    queued: Vector | None = None
    error: GcsError = GcsError.NONE
    leg_stalled: bool = False
    stalled_for_s: float = 0.0
    servo_broken: bool = False
    emergency_stop: bool = False
    was_unheld: bool = False
    limit_switch: bool = False
    encoder_jump_mm: float = 0.0
    brake_slips: bool = False
    has_slipped: bool = False

    @property
    def pose(self) -> Vector:
        """Pose now, X Y Z (mm) U V W (degrees), shape (6,)."""
        return self.rest_pose if self.move is None else self.move.pose

    @property
    def measured(self) -> Vector:
        """Pose as the encoders report it, shape (6,)."""
        return np.asarray(self.pose + self.encoder_jump_mm * np.eye(6)[0])

    @property
    def on_target(self) -> bool:
        """At rest under servo control at the commanded pose."""
        return self.servo_on and self.move is None and bool(np.allclose(self.rest_pose, self.target, atol=1e-6))


def initial_state(hexapod: HexapodPart) -> HexapodState:
    """After power-on: at the home pose, locked, not referenced."""
    home = hexapod.home_pose.as_array()
    return HexapodState(home, home, hexapod.pivot_mm, hexapod.speed_limits.translation_mm_per_s)


def advance(hexapod: HexapodPart, state: HexapodState, dt_s: float) -> HexapodState:
    """Let time pass; many short steps give the same as one long step."""
    left_s = dt_s
    if state.brake_slips and not state.servo_on and not state.has_slipped and dt_s > 0.0:
        return _slip(state)
    while state.move is not None:
        if state.leg_stalled:
            return _stall(state, left_s)
        if left_s < state.move.left_s:
            return replace(state, move=state.move.later(left_s))
        left_s -= state.move.left_s
        state = _finish(hexapod, state, state.move)
    return state


def command_move(hexapod: HexapodPart, state: HexapodState, target: Vector) -> HexapodState:
    """Go to a pose, X Y Z (mm) U V W (degrees), shape (6,); raises `GcsRefusal`."""
    _require_motion_allowed(state)
    if not state.referenced:
        raise GcsRefusal(GcsError.NOT_REFERENCED_OR_SERVO_OFF)
    if not reachable(hexapod, state, target):
        raise GcsRefusal(GcsError.OUT_OF_LIMITS)
    if state.move is None:
        return _start(hexapod, state, target, Purpose.TARGET)
    return replace(state, move=stopping(state.move), target=target, queued=target)


def reachable(hexapod: HexapodPart, state: HexapodState, target: Vector) -> bool:
    """Whether the straight way to a pose, from where the platform would come to rest, is within all limits."""
    start = state.rest_pose if state.move is None else stopping(state.move).resting_pose
    return not path_violations(hexapod, PlatformPose.from_array(start), PlatformPose.from_array(target), state.pivot_mm)


def reference(hexapod: HexapodPart, state: HexapodState, encoders: Encoders) -> HexapodState:
    """Find the reference: at once with absolute encoders, by a move home with incremental ones."""
    if state.emergency_stop:
        raise GcsRefusal(GcsError.EMERGENCY_STOP)
    match encoders:
        case Encoders.ABSOLUTE:
            return replace(state, referenced=True)
        case Encoders.INCREMENTAL:
            _require_motion_allowed(state)
            unknown = replace(end_move(state), referenced=False)
            return _start(hexapod, unknown, hexapod.home_pose.as_array(), Purpose.REFERENCE)


def halt(state: HexapodState) -> HexapodState:
    """Come to rest smoothly; error 10."""
    if state.move is None:
        return replace(state, error=GcsError.STOPPED)
    move = stopping(state.move)
    return replace(state, move=move, target=move.resting_pose, queued=None, error=GcsError.STOPPED)


def stop(state: HexapodState) -> HexapodState:
    """Be at rest at once; error 10."""
    return replace(end_move(state), error=GcsError.STOPPED)


def end_move(state: HexapodState) -> HexapodState:
    """Be at rest here and now, with this pose as the target."""
    pose = state.pose
    return replace(state, rest_pose=pose, target=pose, move=None, queued=None, stalled_for_s=0.0)


def switch_servo_on(state: HexapodState) -> HexapodState:
    """Hold the pose by servo control; raises `GcsRefusal` while a fault forbids it."""
    if state.emergency_stop:
        raise GcsRefusal(GcsError.EMERGENCY_STOP)
    if state.servo_broken:
        raise GcsRefusal(GcsError.MOTION_ERROR)
    return state if state.servo_on else replace(state, servo_on=True, target=state.rest_pose)


def switch_servo_off(state: HexapodState) -> HexapodState:
    """Let go by servo; a move ends."""
    return _note_holding(replace(end_move(state), servo_on=False))


def apply_brake(state: HexapodState) -> HexapodState:
    """Hold by brake; a move ends."""
    return replace(end_move(state), brake_on=True)


def release_brake(state: HexapodState) -> HexapodState:
    """Let go by brake; raises `GcsRefusal` while the emergency stop is pressed."""
    if state.emergency_stop:
        raise GcsRefusal(GcsError.EMERGENCY_STOP)
    return _note_holding(replace(state, brake_on=False))


def set_velocity(hexapod: HexapodPart, state: HexapodState, velocity_mm_per_s: float) -> HexapodState:
    """Set the system velocity for later moves; raises `GcsRefusal`."""
    if not 0.0 < velocity_mm_per_s <= hexapod.speed_limits.translation_mm_per_s:
        raise GcsRefusal(GcsError.VELOCITY_OUT_OF_LIMITS)
    return replace(state, velocity_mm_per_s=velocity_mm_per_s)


def set_pivot(state: HexapodState, pivot_mm: Vector) -> HexapodState:
    """Set the centre of rotation, shape (3,): only with U V W at zero, where X Y Z keep their meaning."""
    if np.array_equal(pivot_mm, state.pivot_mm):
        return state
    if state.move is not None or np.any(np.abs(state.rest_pose[3:]) > 1e-9):
        raise GcsRefusal(GcsError.PIVOT_WHILE_ROTATED)
    return replace(state, pivot_mm=pivot_mm)


def with_error(state: HexapodState, error: GcsError) -> HexapodState:
    """The same state with an error pending."""
    return replace(state, error=error)


def trip(state: HexapodState, error: GcsError) -> HexapodState:
    """End any move, brake and let the servo go, as the controller does by itself when something is wrong."""
    return replace(apply_brake(state), servo_on=False, error=error)


def power_off(state: HexapodState) -> HexapodState:
    """Without power the platform is braked where it is, and nothing but its place is remembered."""
    return replace(trip(state, GcsError.NONE), referenced=False)


def _require_motion_allowed(state: HexapodState) -> None:
    if state.emergency_stop:
        raise GcsRefusal(GcsError.EMERGENCY_STOP)
    if state.limit_switch:
        raise GcsRefusal(GcsError.LIMIT_SWITCH)
    if not state.servo_on or state.brake_on:
        raise GcsRefusal(GcsError.NOT_REFERENCED_OR_SERVO_OFF)


def _note_holding(state: HexapodState) -> HexapodState:
    return replace(state, was_unheld=state.was_unheld or not (state.servo_on or state.brake_on))


def _start(hexapod: HexapodPart, state: HexapodState, target: Vector, purpose: Purpose) -> HexapodState:
    move = move_between(state.rest_pose, target, hexapod.speed_limits, state.velocity_mm_per_s, purpose)
    if move is None:
        return replace(state, target=target, referenced=state.referenced or purpose is Purpose.REFERENCE)
    return replace(state, target=target, move=move)


def _finish(hexapod: HexapodPart, state: HexapodState, move: Move) -> HexapodState:
    end = move.resting_pose if move.purpose is Purpose.STOP else state.target
    referenced = state.referenced or move.purpose is Purpose.REFERENCE
    rested = replace(state, rest_pose=end, move=None, referenced=referenced)
    if rested.queued is None:
        return rested
    return _start(hexapod, replace(rested, queued=None), rested.queued, Purpose.TARGET)


def _slip(state: HexapodState) -> HexapodState:
    """Held by a bad brake alone, the platform sinks towards the bone, and stays there."""
    sunk = state.rest_pose - SLIP_MM * np.eye(6)[2]
    return replace(state, rest_pose=sunk, target=sunk, has_slipped=True)


def _stall(state: HexapodState, dt_s: float) -> HexapodState:
    """The platform hangs behind its target until the controller notices and lets the servo go."""
    stalled_for_s = state.stalled_for_s + dt_s
    if stalled_for_s < STALL_TRIP_S:
        return replace(state, stalled_for_s=stalled_for_s)
    return trip(state, GcsError.MOTION_ERROR)
