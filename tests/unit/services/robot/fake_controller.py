"""A controller without a line: does what it is told at once, or fails when told to."""

import time
from collections.abc import Callable
from dataclasses import replace

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback, ErrorKind
from services.robot.devices.controller import ControllerSilent, StopInForce
from shared.errors import DeviceError
from shared.geometry.hexapod import ZERO_POSE, PlatformPose

STOPPED = ControllerError(ErrorKind.STOPPED_BY_COMMAND, "the controller was stopped by a command")
BUTTON_PRESSED = ControllerError(ErrorKind.STOP_BUTTON_PRESSED, "the controller's stop button is pressed")
BUTTON_RELEASED = ControllerError(ErrorKind.STOP_BUTTON_RELEASED, "the controller's stop button was pressed")
FAULT = ControllerError(ErrorKind.FAULT, "a leg does not follow; free it")
AT_REST = ControllerFeedback(
    pose=ZERO_POSE, moving=False, on_target=True, locked=True, unlocked=False, referenced=False, error=None
)


class FakeController:
    """Keeps one `ControllerFeedback` up to date; `failures` are raised by the next calls, in order."""

    def __init__(self) -> None:
        self.feedback = AT_REST
        self.target = ZERO_POSE
        self.stopped = True
        self.closed = False
        self.asked_to_move = 0
        self.motions: list[PlatformPose] = []
        self.failures: list[str] = []
        self.silent = False
        self.button_error: ControllerError | None = None
        self.brakes_hold = True
        self.line_broken = ""
        self.stops_taken: list[float] = []
        self.before_move: Callable[[], object] = lambda: None
        self.before_lock: Callable[[], object] = lambda: None
        self.after_read: Callable[[], object] = lambda: None

    @property
    def identity(self) -> str:
        """A name."""
        return "fake controller"

    def read(self) -> ControllerFeedback:
        """The present state; asking clears the error."""
        self._fail_if_told()
        if self.silent:
            raise ControllerSilent("no answer within 0.25 s")
        feedback, self.feedback = self.feedback, replace(self.feedback, error=None)
        feedback = replace(feedback, error=self.button_error or feedback.error)
        self.after_read()
        return feedback

    def reference(self) -> None:
        """Absolute encoders: at once, without motion."""
        self._fail_if_told()
        if self.stopped:
            raise StopInForce("a stop is in force")
        self.feedback = replace(self.feedback, referenced=True)

    def move(self, target: PlatformPose, speed_mm_per_s: float) -> None:
        """Unlock and begin."""
        self.asked_to_move += 1
        self._fail_if_told()
        self.before_move()
        if self.stopped:
            raise StopInForce("a stop is in force")
        assert speed_mm_per_s > 0.0
        self.target = target
        self.motions.append(target)
        self.feedback = replace(self.feedback, locked=False, unlocked=True, moving=True, on_target=False)

    def lock(self) -> None:
        """Brakes on, servos off, if they do."""
        self._fail_if_told()
        self.before_lock()
        if not self.brakes_hold:
            raise DeviceError("the robot does not lock")
        self.feedback = replace(self.feedback, locked=True, unlocked=False, moving=False)

    def stop_now(self) -> DeviceError | None:
        """Stop and lock, as the driver's blind message does."""
        self.stopped = True
        self.stops_taken.append(time.monotonic())
        if self.line_broken:
            return ControllerSilent(self.line_broken)
        locked = self.brakes_hold or self.feedback.locked
        self.feedback = replace(self.feedback, moving=False, locked=locked, unlocked=not locked, error=STOPPED)
        return None

    def release_stop(self) -> None:
        """Let motions through."""
        self.stopped = False

    def close(self) -> None:
        """Leave."""
        self.closed = True

    def arrive(self, where: PlatformPose | None = None) -> None:
        """A move that is under way ends."""
        if self.feedback.moving:
            self.feedback = replace(self.feedback, pose=where or self.target, moving=False, on_target=True)

    def _fail_if_told(self) -> None:
        if self.failures:
            raise DeviceError(self.failures.pop(0))
