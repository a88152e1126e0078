"""The motion table, and everything that it decides about, under one lock that is held for milliseconds at most.

Here the state changes and a stop goes out, from whatever thread it comes. All that needs the controller's answer is
left to the worker, as effects that are still to be carried out.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from services.robot.core.motion import Effect, Event, Transition, next_motion
from services.robot.core.refusals import Refusal
from services.robot.core.status import DriveStatus
from services.robot.core.stop_button import after_connection
from services.robot.core.stop_result import SentStop
from services.robot.devices.controller import HexapodController
from shared.robot_states import StopButton

_AT_ONCE = (Effect.STOP_NOW, Effect.RELEASE_STOP)


@dataclass(frozen=True, slots=True)
class Job:
    """What the worker is to do: the effects of the last transition, on the controller that it was made for."""

    effects: tuple[Effect, ...]
    generation: int
    controller: HexapodController


class MotionController:
    """What is known of the robot, and what is still to be done.

    Parameters
    ----------
    stop_button
        What is known of the controller's own button.
    """

    def __init__(self, stop_button: StopButton) -> None:
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._wake = threading.Event()
        self._closing = False
        self._status = DriveStatus(stop_button=stop_button)
        self._pending: tuple[Effect, ...] = ()
        self._controller: HexapodController | None = None
        self._counting = threading.Lock()
        self._stops = 0

    @property
    def status(self) -> DriveStatus:
        """What is known now."""
        return self._status

    @property
    def controller(self) -> HexapodController | None:
        """Who is connected now."""
        return self._controller

    @contextmanager
    def deciding(self) -> Iterator[DriveStatus]:
        """Nothing changes but by the caller's hand, while it decides; no question to a controller belongs here."""
        with self._lock:
            yield self._status

    def wait_for_change(self, seen: DriveStatus, timeout_s: float) -> DriveStatus:
        """Wait until the status is another than `seen`, at most `timeout_s`."""
        with self._changed:
            self._changed.wait_for(lambda: self._status is not seen, timeout_s)
            return self._status

    @property
    def stops(self) -> int:
        """How many stops have been sent."""
        return self._stops

    def halt(self) -> SentStop:
        """Send the stop to the controller and nothing else; waits for no lock but the counter's."""
        controller = self._controller
        if controller is None:
            not_written = "the controller is not connected"
        else:
            error = controller.stop_now()
            not_written = "" if error is None else str(error)
        # Counted after it was written: whoever reads the number before a question asks after the stop.
        with self._counting:
            self._stops += 1
            return SentStop(self._stops, not_written)

    def apply(self, event: Event, detail: str) -> None:
        """Let an event happen: the state changes at once, a stop goes out at once, the worker does the rest."""
        with self._lock:
            transition = next_motion(self._status.state, event)
            if isinstance(transition, Refusal) or transition == Transition(self._status.state):
                return
            self._perform_at_once(transition)
            # Replaced, not appended to: a motion that has not begun must not begin after a stop.
            self._pending = tuple(e for e in transition.effects if e not in _AT_ONCE) or self._pending
            self.note(self._status.after_transition(event, transition.state, detail))
        self._wake.set()

    def _perform_at_once(self, transition: Transition) -> None:
        if Effect.STOP_NOW in transition.effects:
            self.halt()
        if Effect.RELEASE_STOP in transition.effects and self._controller is not None:
            self._controller.release_stop()

    def note(self, status: DriveStatus) -> None:
        """Replace what is known; the state itself changes in `apply` alone."""
        with self._changed:
            self._status = status
            self._changed.notify_all()

    def hold(self) -> None:
        """Stop and lock once more, whatever the state: until the guide is held."""
        with self._lock:
            self.halt()
            self._pending = (Effect.LOCK,)

    def connected(self, controller: HexapodController, now_s: float) -> bool:
        """Take a controller that answers; False when nobody wants it any more, and it is the caller's to close."""
        with self._lock:
            if self._closing:
                return False
            self._controller = controller
            known = replace(self._status, identity=controller.identity, connected_s=now_s, feedback=None)
            self.note(replace(known, stop_button=after_connection(known.stop_button)))
            self.apply(Event.CONNECTED, "connected; the stop is in force until a person acknowledges it")
            return True

    def disconnected(self) -> None:
        """Forget the controller and its feedback."""
        with self._lock:
            self._controller = None
            self.note(replace(self._status, feedback=None))

    def close_line(self) -> None:
        """Close what a worker that failed left open; its guardian then stops the robot once more if it was armed."""
        controller = self._controller
        if controller is not None:
            self.disconnected()
            controller.close()

    def leave(self, why: str) -> None:
        """Stop, lock, disconnect, and connect no more."""
        with self._lock:
            self.apply(Event.SHUT_DOWN, why)
            self._closing = True
        self._wake.set()

    @property
    def finished(self) -> bool:
        """Whether it was left and nothing is still to be done."""
        return self._closing and not self._pending

    def take_job(self) -> Job | None:
        """What is still to be done; handed out once, and not at all without a controller."""
        with self._lock:
            effects, self._pending = self._pending, ()
            generation, controller = self._status.generation, self._controller
        return None if controller is None else Job(effects, generation, controller)

    def wait_for_work(self, timeout_s: float) -> None:
        """Wait until something is to be done, at most `timeout_s`."""
        if not self._pending:
            self._wake.wait(timeout_s)
        self._wake.clear()
