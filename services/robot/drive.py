"""Carries the motion table out on a controller: one thread works, any thread may stop.

The table decides, under a lock that is held for milliseconds at most; the worker thread alone asks the controller
questions. A stop goes to the controller before anything else, from whatever thread it comes, and waits for neither.
"""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import assert_never

from services.robot.core.guard import PermittedMove
from services.robot.core.motion import Effect, Event, MotionState, Transition, next_motion
from services.robot.core.readings import Deviation
from services.robot.core.refusals import Refusal
from services.robot.core.status import UNDER_WAY, DriveStatus, ReferenceUnderWay, locked_reading, with_reading
from services.robot.core.stop_button import StopButton, after_connection
from services.robot.core.supervision import MoveUnderWay
from services.robot.devices.controller import ControllerSilent, HexapodController, StopInForce
from shared.errors import DeviceError

Guard = Callable[[DriveStatus], PermittedMove | Refusal]

POLL_MOVING_S = 0.02
POLL_AT_REST_S = 0.1
# Locked at rest, nothing is in danger while a busy controller is slow: it may be asked again for this long.
SILENCE_AT_REST_S = 1.0
_AT_ONCE = (Effect.STOP_NOW, Effect.RELEASE_STOP)


class Drive:
    """A robot behind a connection that may come and go.

    Parameters
    ----------
    connect
        Connects to the controller; raises `DeviceError` when it cannot.
    reference_travel
        How far the robot may move for reference: nothing to speak of with absolute encoders.
    clock_s
        Monotonic clock.
    retry_s
        Time between attempts to connect.
    on_crash
        Called with a sentence when the worker has failed by a fault of this program; the robot has been stopped then.
    stop_button
        What is known of the controller's own button: `ABSENT`, or `RELEASED` until somebody acknowledges.
    """

    def __init__(
        self,
        connect: Callable[[], HexapodController],
        reference_travel: Deviation,
        clock_s: Callable[[], float],
        retry_s: float,
        on_crash: Callable[[str], None],
        stop_button: StopButton = StopButton.RELEASED,
    ) -> None:
        self._connect = connect
        self._reference_travel = reference_travel
        self._clock_s = clock_s
        self._retry_s = retry_s
        self._on_crash = on_crash
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._wake = threading.Event()
        self._closing = False
        self._status = DriveStatus(stop_button=stop_button)
        self._pending: tuple[Effect, ...] = ()
        self._controller: HexapodController | None = None
        self._answered_s = float("-inf")
        self._worker = threading.Thread(target=self.work, name="drive", daemon=True)

    def start(self) -> None:
        """Begin to connect."""
        self._worker.start()

    def close(self) -> None:
        """Stop, lock, leave the controller, and wait until that is done."""
        self.leave()
        self._worker.join()

    def leave(self) -> None:
        """Stop; the worker then locks, leaves the controller and ends."""
        self.halt()
        with self._lock:
            self._apply(Event.SHUT_DOWN, "the robot service is leaving")
            self._closing = True
        self._wake.set()

    @property
    def status(self) -> DriveStatus:
        """What is known now."""
        return self._status

    def wait_for_change(self, seen: DriveStatus, timeout_s: float) -> DriveStatus:
        """Wait until the status is another than `seen`, at most `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._status is not seen, timeout_s)
            return self._status

    def stop(self, why: str) -> None:
        """Stop and lock. Waits for nothing; possible in every state."""
        self.halt()
        self._apply(Event.STOP, why)

    def supervision_lost(self, why: str) -> None:
        """Stop and lock if anything is under way."""
        self._apply(Event.SUPERVISION_LOST, why)

    def begin_move(self, command_id: str, guard: Guard) -> Refusal | None:
        """Begin a move that the motion table allows and the guard permits; None when begun."""
        with self._lock:
            planned = next_motion(self._status.state, Event.MOVE)
            permitted = planned if isinstance(planned, Refusal) else guard(self._status)
            if isinstance(permitted, Refusal):
                return permitted
            task = MoveUnderWay(permitted, self._clock_s())
            self._set(replace(self._status, command_id=command_id, outcome="moving", deviation=None, task=task))
            self._apply(Event.MOVE, "the move is under way")
        return None

    def begin_reference(self, command_id: str) -> Refusal | None:
        """Begin reference; None when begun."""
        with self._lock:
            reading = locked_reading(self._status, Event.REFERENCE, self._clock_s())
            if isinstance(reading, Refusal):
                return reading
            task = ReferenceUnderWay(reading.pose, self._reference_travel, self._clock_s())
            self._set(replace(self._status, command_id=command_id, outcome="moving", deviation=None, task=task))
            self._apply(Event.REFERENCE, "reference is under way")
        return None

    def acknowledge_stop(self) -> Refusal | None:
        """Release the stop, on a person's word; None when released."""
        with self._lock:
            reading = locked_reading(self._status, Event.ACKNOWLEDGE_REFERENCED, self._clock_s())
            if isinstance(reading, Refusal):
                return reading
            event = Event.ACKNOWLEDGE_REFERENCED if reading.referenced else Event.ACKNOWLEDGE_UNREFERENCED
            self._apply(event, "the stop was acknowledged")
        return None

    def reset(self) -> Refusal | None:
        """Leave a fault by connecting anew; None when begun."""
        with self._lock:
            planned = next_motion(self._status.state, Event.RESET)
            if isinstance(planned, Refusal):
                return planned
            self._apply(Event.RESET, "connecting anew after a fault")
        return None

    def halt(self) -> None:
        """Send the stop to the controller and nothing else: for who has yet to find out why."""
        controller = self._controller
        if controller is not None:
            controller.stop_now()

    def _apply(self, event: Event, detail: str) -> None:
        """Let an event happen: the state changes at once, a stop goes out at once, the worker does the rest."""
        with self._lock:
            transition = next_motion(self._status.state, event)
            if isinstance(transition, Refusal) or transition == Transition(self._status.state):
                return
            self._perform_at_once(transition)
            # Replaced, not appended to: a motion that has not begun must not begin after a stop.
            self._pending = tuple(e for e in transition.effects if e not in _AT_ONCE) or self._pending
            self._set(self._status.after_transition(event, transition.state, detail))
        self._wake.set()

    def _perform_at_once(self, transition: Transition) -> None:
        if Effect.STOP_NOW in transition.effects:
            self.halt()
        if Effect.RELEASE_STOP in transition.effects and self._controller is not None:
            self._controller.release_stop()

    def _set(self, status: DriveStatus) -> None:
        with self._changed:
            self._status = status
            self._changed.notify_all()

    def step(self) -> bool:
        """One round of the worker's work; False at the end. For the worker thread, or a test in its place."""
        self._do_pending()
        if self._closing and not self._pending:
            return False
        if self._controller is None:
            self._try_to_connect()
        else:
            self._observe(self._controller)
        return True

    def work(self) -> None:
        """What the worker thread does until the end; a fault of this program stops the robot and is raised."""
        try:
            while self.step():
                if not self._pending:
                    self._wake.wait(self._pause_s())
                self._wake.clear()
        except Exception as error:
            self.halt()
            self._apply(Event.FAULT_SEEN, f"the robot service failed: {error!r}; it was stopped, restart the service")
            self._on_crash(f"{type(error).__name__}: {error}")
            raise

    def _pause_s(self) -> float:
        if self._controller is None:
            return self._retry_s
        return POLL_MOVING_S if self._status.state in UNDER_WAY else POLL_AT_REST_S

    def _try_to_connect(self) -> None:
        try:
            controller = self._connect()
        except DeviceError as error:
            with self._lock:
                self._set(replace(self._status, detail=str(error)))
            return
        with self._lock:
            if self._closing:
                controller.close()
                return
            self._controller = controller
            connected = replace(self._status, identity=controller.identity, connected_s=self._clock_s(), reading=None)
            self._set(replace(connected, stop_button=after_connection(connected.stop_button)))
            self._apply(Event.CONNECTED, "connected; the stop is in force until a person acknowledges it")

    def _do_pending(self) -> None:
        with self._lock:
            effects, self._pending = self._pending, ()
            generation, controller = self._status.generation, self._controller
        if controller is None:
            return
        for effect in effects:
            try:
                self._perform(effect, controller)
            except DeviceError as error:
                self._device_failed(error, generation)

    def _perform(self, effect: Effect, controller: HexapodController) -> None:
        match effect:
            case Effect.LOCK:
                controller.lock()
            case Effect.START_MOVE:
                if isinstance(self._status.task, MoveUnderWay):
                    permitted = self._status.task.permitted
                    controller.move(permitted.target, permitted.speed_mm_per_s)
            case Effect.START_REFERENCE:
                controller.reference()
            case Effect.DISCONNECT:
                with self._lock:
                    self._controller = None
                    self._set(replace(self._status, reading=None))
                controller.close()
            case Effect.STOP_NOW | Effect.RELEASE_STOP:
                raise AssertionError(f"'{effect}' is performed at once, never by the worker")
            case _:
                assert_never(effect)

    def _observe(self, controller: HexapodController) -> None:
        generation, began_s = self._status.generation, self._clock_s()
        try:
            reading = controller.read()
        except DeviceError as error:
            if not (isinstance(error, ControllerSilent) and self._silence_is_tolerable(began_s)):
                self._device_failed(error, generation)
            return
        self._answered_s = began_s
        with self._lock:
            if generation != self._status.generation:
                return
            status, finding = with_reading(self._status, reading, began_s, self._clock_s())
            self._set(status)
            if finding is not None:
                self._apply(finding.event, finding.message)
            elif status.state is MotionState.FAULT and not reading.locked:
                # Whatever the fault was, the guide must be held: try until it is.
                self.halt()
                self._pending = (Effect.LOCK,)

    def _silence_is_tolerable(self, began_s: float) -> bool:
        """Whether a controller that did not answer may be asked again; until it answers, nothing is known of it."""
        with self._lock:
            tolerable = (
                self._status.state not in UNDER_WAY
                and self._status.outcome != "moving"
                and began_s - max(self._answered_s, self._status.connected_s) <= SILENCE_AT_REST_S
            )
            if tolerable:
                self._set(replace(self._status, reading=None))
            return tolerable

    def _device_failed(self, error: DeviceError, generation: int) -> None:
        with self._lock:
            if generation != self._status.generation:
                return
            self._set(replace(self._status, reading=None))
            if isinstance(error, StopInForce):
                self._apply(Event.CONTROLLER_STOPPED, str(error))
            elif self._status.state is not MotionState.FAULT:
                self._apply(Event.FAULT_SEEN, str(error))
