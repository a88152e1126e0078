"""The worker speaks with the controller: connects, carries effects out, and passes feedback to the motion table."""

from collections.abc import Callable
from dataclasses import replace
from typing import assert_never

from services.robot.core.motion import Effect, Event
from services.robot.core.status import UNDER_WAY, with_feedback, with_further_fault, with_overtaken_error
from services.robot.core.stop_result import Readback
from services.robot.core.supervision import MoveUnderWay
from services.robot.core.tuning import RATES
from services.robot.devices.controller import ControllerFault, ControllerSilent, HexapodController, StopInForce
from services.robot.drive.motion_controller import MotionController
from shared.errors import DeviceError
from shared.robot_states import MotionState


class Worker:
    """Carries out what the motion controller decides, on one thread.

    Parameters
    ----------
    motion
        What is known, and what is to be done.
    connect
        Connects to the controller; raises `DeviceError` when it cannot.
    clock_s
        Monotonic clock.
    retry_s
        Time between attempts to connect.
    on_crash
        Called with a sentence when the worker has failed by a fault of this program; the robot has been stopped then.
    """

    def __init__(
        self,
        motion: MotionController,
        connect: Callable[[], HexapodController],
        clock_s: Callable[[], float],
        retry_s: float,
        on_crash: Callable[[str], None],
    ) -> None:
        self._motion = motion
        self._connect = connect
        self._clock_s = clock_s
        self._retry_s = retry_s
        self._on_crash = on_crash
        self._answered_s = float("-inf")

    def work(self) -> None:
        """What the worker thread does until the end; a fault of this program stops the robot and is raised."""
        motion = self._motion
        try:
            while self.step():
                motion.wait_for_work(self._pause_s())
        except Exception as error:
            motion.halt()
            motion.apply(Event.FAULT_SEEN, f"the robot service failed: {error!r}; it was stopped, restart the service")
            self._on_crash(f"{type(error).__name__}: {error}")
            raise

    def step(self) -> bool:
        """One round of the work; False at the end."""
        generation = self._do_pending()
        if self._motion.finished:
            return False
        controller = self._motion.controller
        if controller is None:
            self._try_to_connect()
        else:
            self._observe(controller, generation)
        return True

    def _pause_s(self) -> float:
        if self._motion.controller is None:
            return self._retry_s
        return RATES.poll_moving_s if self._motion.status.state in UNDER_WAY else RATES.poll_at_rest_s

    def _try_to_connect(self) -> None:
        try:
            controller = self._connect()
        except DeviceError as error:
            with self._motion.deciding() as status:
                self._motion.note(replace(status, detail=str(error)))
            return
        if not self._motion.connected(controller, self._clock_s()):
            controller.close()

    def _do_pending(self) -> int:
        """Carry out what is to be done; the generation in which that was all.

        A motion that is asked for from now on has not begun when the next feedback is: that must not pass for one that
        has ended.
        """
        job = self._motion.take_job()
        if job is None:
            return self._motion.status.generation
        for effect in job.effects:
            try:
                self._perform(effect, job.controller)
            except DeviceError as error:
                self._device_failed(error, job.generation)
        return job.generation

    def _perform(self, effect: Effect, controller: HexapodController) -> None:
        match effect:
            case Effect.LOCK:
                controller.lock()
            case Effect.START_MOVE:
                task = self._motion.status.task
                if isinstance(task, MoveUnderWay):
                    controller.move(task.permitted.target, task.permitted.speed_mm_per_s)
            case Effect.START_REFERENCE:
                controller.reference()
            case Effect.DISCONNECT:
                self._motion.disconnected()
                controller.close()
            case Effect.STOP_NOW | Effect.RELEASE_STOP:
                raise AssertionError(f"'{effect}' is performed at once, never by the worker")
            case _:
                assert_never(effect)

    def _observe(self, controller: HexapodController, generation: int) -> None:
        stops, began_s = self._motion.stops, self._clock_s()
        try:
            feedback = controller.read()
        except DeviceError as error:
            if not (isinstance(error, ControllerSilent) and self._silence_is_tolerable(began_s)):
                self._device_failed(error, generation)
            return
        self._answered_s = began_s
        with self._motion.deciding() as before:
            known = replace(before, readback=Readback(stops, not feedback.moving, feedback.locked))
            self._motion.note(known)
            if generation == known.generation:
                status, finding = with_feedback(known, feedback, began_s, self._clock_s())
            else:
                status, finding = with_overtaken_error(known, feedback.error)
            self._motion.note(status)
            if finding is not None:
                self._motion.apply(finding.event, finding.message)
            elif generation == known.generation and status.state is MotionState.FAULT and not feedback.locked:
                # Whatever the fault was, the guide must be held: try until it is.
                self._motion.hold()

    def _silence_is_tolerable(self, began_s: float) -> bool:
        """Whether a controller that did not answer may be asked again; until it answers, nothing is known of it."""
        with self._motion.deciding() as status:
            tolerable = (
                status.state not in UNDER_WAY
                and status.outcome != "moving"
                and began_s - max(self._answered_s, status.connected_s) <= RATES.silence_at_rest_s
            )
            if tolerable:
                self._motion.note(replace(status, feedback=None))
            return tolerable

    def _device_failed(self, error: DeviceError, generation: int) -> None:
        with self._motion.deciding() as status:
            if generation != status.generation and not isinstance(error, ControllerFault):
                return
            self._motion.note(replace(status, feedback=None))
            if isinstance(error, StopInForce):
                self._motion.apply(Event.CONTROLLER_STOPPED, str(error))
            elif status.state is not MotionState.FAULT:
                self._motion.apply(Event.FAULT_SEEN, str(error))
            elif isinstance(error, ControllerFault):
                self._motion.note(with_further_fault(self._motion.status, str(error)))
