"""The player: the pure model, a clock, and a lock, so that any number of connections and the world share one robot.

The state is advanced when it is asked for: there is no thread that ticks.
"""

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass

from shared.geometry.frames import RobotBase, RobotTop
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.transform import Transform
from simulation.controller.accuracy import PlatformError, perfect
from simulation.controller.faults import Fault, with_fault, without_fault
from simulation.controller.gcs_commands import Controller, obey, obey_byte
from simulation.controller.gcs_protocol import GcsRefusal, SingleByte, parse_line
from simulation.controller.hexapod_model import Encoders, HexapodState, advance, initial_state, with_error
from simulation.controller.line_faults import answered, carried, reply_delay_s


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """What is true of the robot at one moment.

    Attributes
    ----------
    pose
        Where the platform really is.
    measured_pose
        What its encoders report.
    held
        By servo or brake; `was_unheld` says whether it ever was by neither.
    error
        The controller's pending error code.
    at_rest_since_s, locked_since_s
        When the last motion ended, and since when the brake holds and the servo is off, on the controller's clock; None
        while it moves, and while it is not locked.
    """

    pose: PlatformPose
    measured_pose: PlatformPose
    base_from_top: Transform[RobotBase, RobotTop]
    moving: bool
    servo_on: bool
    brake_on: bool
    referenced: bool
    held: bool
    was_unheld: bool
    error: int
    faults: frozenset[Fault]
    at_rest_since_s: float | None
    locked_since_s: float | None


class VirtualController:
    """One virtual hexapod with its controller.

    Parameters
    ----------
    hexapod
        What it looks like.
    clock_s
        Monotonic clock in seconds, such as `time.monotonic`.
    error
        How the platform differs from its encoders.
    encoders
        What `FRF` does.
    noise
        Chance on a bad line.
    """

    def __init__(
        self,
        hexapod: HexapodPart,
        clock_s: Callable[[], float],
        error: PlatformError | None = None,
        encoders: Encoders = Encoders.ABSOLUTE,
        noise: random.Random | None = None,
    ) -> None:
        self.hexapod = hexapod
        self._controller = Controller(hexapod, encoders)
        self._clock_s = clock_s
        self._error = error or perfect()
        self._lock = threading.Lock()
        self._state = initial_state(hexapod)
        self._seen_s = clock_s()
        self._at_rest_since_s: float | None = self._seen_s
        self._locked_since_s: float | None = self._seen_s
        self._faults: frozenset[Fault] = frozenset()
        self._noise = noise or random.Random(0)

    def receive(self, command: str | SingleByte) -> bytes:
        """Obey a line or a single-byte command; the reply may be empty."""
        with self._lock:
            if self._faults & {Fault.SILENCE, Fault.POWER_CYCLE}:
                return b""
            state, reply = self._obey(self._now(), command)
            self._take(state, self._seen_s)
            return answered(command, reply, self._faults)

    def carried(self, content: bytes) -> bytes:
        """Bytes, going either way, as the line lets them arrive."""
        with self._lock:
            return carried(content, self._faults, self._noise)

    def reply_delay_s(self) -> float:
        """How late answers come now."""
        return reply_delay_s(self._faults)

    def inject(self, fault: Fault) -> None:
        """Let something go wrong until it is cleared."""
        with self._lock:
            self._take(with_fault(self._now(), fault), self._seen_s)
            self._faults |= {fault}

    def clear(self, fault: Fault) -> None:
        """Mend it; nothing is switched on by that."""
        with self._lock:
            self._take(without_fault(self._now(), fault), self._seen_s)
            self._faults -= {fault}

    def pose(self) -> PlatformPose:
        """Where the platform really is now."""
        return self.snapshot().pose

    def snapshot(self) -> Snapshot:
        """Everything that is true now."""
        with self._lock:
            state = self._now()
            faults, at_rest_since_s, locked_since_s = self._faults, self._at_rest_since_s, self._locked_since_s
        measured = PlatformPose.from_array(state.measured)
        pose = self._error.true_pose(PlatformPose.from_array(state.pose))
        return Snapshot(
            pose=pose,
            measured_pose=measured,
            base_from_top=base_from_top(self.hexapod, pose, state.pivot_mm),
            moving=state.move is not None,
            servo_on=state.servo_on,
            brake_on=state.brake_on,
            referenced=state.referenced,
            held=state.servo_on or state.brake_on,
            was_unheld=state.was_unheld,
            error=int(state.error),
            faults=faults,
            at_rest_since_s=at_rest_since_s,
            locked_since_s=locked_since_s,
        )

    def _now(self) -> HexapodState:
        """The state now, and from now on."""
        now_s = self._clock_s()
        elapsed_s, self._seen_s = now_s - self._seen_s, now_s
        move = self._state.move
        left_s = elapsed_s if move is None else min(move.left_s, elapsed_s)
        return self._take(advance(self.hexapod, self._state, elapsed_s), now_s - elapsed_s + left_s)

    def _take(self, state: HexapodState, changed_s: float) -> HexapodState:
        """Keep a state, and since when it is at rest and locked."""
        self._state = state
        if state.move is not None:
            self._at_rest_since_s = None
        elif self._at_rest_since_s is None:
            self._at_rest_since_s = changed_s
        if state.servo_on or not state.brake_on:
            self._locked_since_s = None
        elif self._locked_since_s is None:
            self._locked_since_s = changed_s
        return state

    def _obey(self, state: HexapodState, command: str | SingleByte) -> tuple[HexapodState, bytes]:
        if isinstance(command, SingleByte):
            return obey_byte(state, command)
        try:
            line = parse_line(command)
        except GcsRefusal as refusal:
            return with_error(state, refusal.error), b""
        return (state, b"") if line is None else obey(self._controller, state, line)
