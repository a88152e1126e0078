"""A robot behind a connection that may come and go: what others may ask of it.

The table decides, under a lock that is held for milliseconds at most (`motion_controller`); the worker thread alone
asks the controller questions (`worker`). A stop goes to the controller before anything else, from whatever thread it
comes, and waits for neither.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace

from services.robot.core.deviation import Deviation
from services.robot.core.guard import PermittedMove
from services.robot.core.motion import Event, next_motion
from services.robot.core.refusals import Refusal, RefusalCode, refusal
from services.robot.core.status import DriveStatus, ReferenceUnderWay, locked_feedback
from services.robot.core.stop_result import SentStop
from services.robot.core.supervision import MoveUnderWay
from services.robot.devices.controller import HexapodController
from services.robot.devices.guardian import UNGUARDED, LineGuardian
from services.robot.drive.motion_controller import MotionController
from services.robot.drive.stop_confirmation import StopAnswer, StopConfirmation
from services.robot.drive.worker import Worker
from shared.robot_states import StopButton
from shared.threads import supervised_thread

Guard = Callable[[DriveStatus], PermittedMove | Refusal]


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
    guardian
        Who stops the robot when this process cannot: nothing is begun without.
    """

    def __init__(
        self,
        connect: Callable[[], HexapodController],
        reference_travel: Deviation,
        clock_s: Callable[[], float],
        retry_s: float,
        on_crash: Callable[[str], None],
        stop_button: StopButton = StopButton.RELEASED,
        guardian: LineGuardian = UNGUARDED,
    ) -> None:
        self._guardian = guardian
        self._reference_travel = reference_travel
        self._clock_s = clock_s
        self._motion = MotionController(stop_button)
        self._worker = Worker(self._motion, connect, clock_s, retry_s, on_crash)
        self._thread = supervised_thread("drive", self.work)
        self._confirmation = StopConfirmation(self._motion, clock_s)

    def start(self) -> None:
        """Begin to connect."""
        self._thread.start()
        self._confirmation.start()

    def close(self) -> None:
        """Stop, lock, leave the controller, and wait until that is done."""
        self.leave()
        self._thread.join()
        self._motion.close_line()
        self._confirmation.close()

    def leave(self) -> None:
        """Stop; the worker then locks, leaves the controller and ends."""
        self.halt()
        self._motion.leave("the robot service is leaving")

    @property
    def status(self) -> DriveStatus:
        """What is known now."""
        return self._motion.status

    def deciding(self) -> AbstractContextManager[DriveStatus]:
        """Nothing changes but by the caller's hand, while it decides; see `MotionController`."""
        return self._motion.deciding()

    def wait_for_change(self, seen: DriveStatus, timeout_s: float) -> DriveStatus:
        """Wait until the status is another than `seen`, at most `timeout_s`."""
        return self._motion.wait_for_change(seen, timeout_s)

    def stop(self, why: str) -> SentStop:
        """Stop and lock. Waits for nothing; possible in every state."""
        sent = self.halt()
        self._motion.apply(Event.STOP, why)
        return sent

    def when_confirmed(self, sent: SentStop, answer: StopAnswer) -> None:
        """Call with what became of a stop, from another thread, within half a second."""
        self._confirmation.ask(sent, answer)

    def supervision_lost(self, why: str) -> None:
        """Stop and lock if anything is under way."""
        self._motion.apply(Event.SUPERVISION_LOST, why)

    def begin_move(self, command_id: str, guard: Guard) -> Refusal | None:
        """Begin a move that the motion table allows and the guard permits; None when begun."""
        with self._motion.deciding() as status:
            planned = next_motion(status.state, Event.MOVE)
            permitted = planned if isinstance(planned, Refusal) else self._unguarded() or guard(status)
            if isinstance(permitted, Refusal):
                return permitted
            self._begin(status, command_id, MoveUnderWay(permitted, self._clock_s()))
            self._motion.apply(Event.MOVE, "the move is under way")
        return None

    def begin_reference(self, command_id: str) -> Refusal | None:
        """Begin reference; None when begun."""
        with self._motion.deciding() as status:
            feedback = self._unguarded() or locked_feedback(status, Event.REFERENCE, self._clock_s())
            if isinstance(feedback, Refusal):
                return feedback
            self._begin(status, command_id, ReferenceUnderWay(feedback.pose, self._reference_travel, self._clock_s()))
            self._motion.apply(Event.REFERENCE, "reference is under way")
        return None

    def _unguarded(self) -> Refusal | None:
        lost = self._guardian.lost()
        return refusal(RefusalCode.GUARDIAN_MISSING, lost) if lost else None

    def _begin(self, status: DriveStatus, command_id: str, task: MoveUnderWay | ReferenceUnderWay) -> None:
        self._motion.note(replace(status, command_id=command_id, outcome="moving", deviation=None, task=task))

    def acknowledge_stop(self) -> Refusal | None:
        """Release the stop because a person acknowledges it; None when released."""
        with self._motion.deciding() as status:
            feedback = locked_feedback(status, Event.ACKNOWLEDGE_REFERENCED, self._clock_s())
            if isinstance(feedback, Refusal):
                return feedback
            event = Event.ACKNOWLEDGE_REFERENCED if feedback.referenced else Event.ACKNOWLEDGE_UNREFERENCED
            self._motion.apply(event, "the stop was acknowledged")
        return None

    def reset(self) -> Refusal | None:
        """Leave a fault by connecting anew; None when begun."""
        with self._motion.deciding() as status:
            planned = next_motion(status.state, Event.RESET)
            if isinstance(planned, Refusal):
                return planned
            self._motion.apply(Event.RESET, "connecting anew after a fault")
        return None

    def halt(self) -> SentStop:
        """Send the stop to the controller and nothing else: for who has yet to find out why."""
        return self._motion.halt()

    def fail(self, why: str) -> None:
        """Stop and lock because the service itself has failed: the stop goes out before anything else."""
        self.halt()
        self._motion.apply(Event.FAULT_SEEN, f"the robot service failed: {why}; it was stopped, restart the service")

    def step(self) -> bool:
        """One round of the worker's work; False at the end. For the worker thread, or a test in its place."""
        return self._worker.step()

    def work(self) -> None:
        """What the worker thread does until the end; a fault of this program stops the robot and is raised."""
        self._worker.work()
