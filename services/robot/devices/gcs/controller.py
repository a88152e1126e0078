"""A hexapod controller that speaks PI GCS 2.0."""

from functools import partial

import numpy as np

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback, ErrorKind
from services.robot.core.deviation import deviation
from services.robot.core.tuning import CONTROLLER_LINE, SUPERVISION
from services.robot.devices.controller import ControllerFault, Encoders, ReplyGarbled, StopInForce
from services.robot.devices.gcs import codec
from services.robot.devices.gcs.errors import controller_error
from services.robot.devices.guardian import UNGUARDED, LineGuardian
from services.robot.devices.serial_line import LineProtocol, SerialLine
from services.robot.devices.serial_port import Port
from shared.errors import DeviceError
from shared.geometry.hexapod import AXES, HexapodPart, PlatformPose

BRAKES_ON = codec.command("BRA", codec.on_all_axes(1))
BRAKES_OFF = codec.command("BRA", codec.on_all_axes(0))
SERVOS_ON = codec.command("SVO", codec.on_all_axes(1))
SERVOS_OFF = codec.command("SVO", codec.on_all_axes(0))
# A disturbed line can spoil one command and carry the next, and then neither brake nor servo would hold. Where the
# brakes cannot be read back before the servos go off, they are sent so often that one of the commands arrives.
LOCK_UNCONFIRMED = 6 * BRAKES_ON + SERVOS_OFF
LINE = LineProtocol(
    stop_message=codec.STOP_ALL,
    # Locking must not wait for anybody's question either.
    lock_message=LOCK_UNCONFIRMED,
    marker_question=codec.query("SAI"),
    marker_answer=AXES,
    # "AXIS=VALUE" lines of one answer: each but the last ends in a space.
    another_line_follows=lambda line: line.endswith(" "),
)
PIVOT_AXES = ("R", "S", "T")
_BUTTON_ERRORS = (ErrorKind.STOP_BUTTON_PRESSED, ErrorKind.STOP_BUTTON_RELEASED)


class GcsController:
    """The controller behind a port, stopped and locked as found or made so.

    Raises
    ------
    DeviceError
        When it does not answer, is not a GCS 2.0 hexapod with the axes X Y Z U V W, or cannot be locked.
    """

    def __init__(
        self,
        port: Port,
        hexapod: HexapodPart,
        encoders: Encoders = Encoders.ABSOLUTE,
        reply_timeout_s: float = CONTROLLER_LINE.reply_timeout_s,
        guardian: LineGuardian = UNGUARDED,
    ) -> None:
        self._encoders = encoders
        self._button_error: ControllerError | None = None
        self._late_error: ControllerError | None = None
        self._line = SerialLine(port, LINE, reply_timeout_s, guardian)
        try:
            self._line.stop_now()
            self._check_axes()
            self.lock()
            self._identity = self._line.ask(codec.query("*IDN"), partial(codec.parse_text, question="*IDN?"))
            self._check_syntax_version()
            self._set_pivot(hexapod)
            self._line.wait_for_guardian()
        except DeviceError:
            self._line.close()
            raise

    @property
    def identity(self) -> str:
        """What the controller answered to `*IDN?`."""
        return self._identity

    def read(self) -> ControllerFeedback:
        """Ask for everything; about 8 questions. See `HexapodController`."""
        brakes = self._switches("BRA")
        servos = self._switches("SVO")
        pose = self._pose("POS")
        moving = self._line.ask(codec.MOTION_STATUS, codec.parse_motion_status)
        on_target = self._switches("ONT")
        referenced = self._switches("FRF")
        if not moving:
            self._confirm_at_rest(pose)
        return ControllerFeedback(
            pose=pose,
            moving=moving,
            on_target=all(on_target),
            locked=all(brakes) and not any(servos),
            unlocked=not any(brakes) and all(servos),
            referenced=all(referenced),
            error=self._pending_error(),
        )

    def reference(self) -> None:
        """Begin reference of all axes: locked with absolute encoders, unlocked with incremental ones."""
        if self._encoders is Encoders.INCREMENTAL:
            self._unlock()
        self._line.write_unless_stopped(b"FRF " + " ".join(AXES).encode("ascii") + b"\n")
        self._refuse_errors("reference")

    def move(self, target: PlatformPose, speed_mm_per_s: float) -> None:
        """Check, set the speed, unlock, and begin; see `HexapodController`."""
        self._check_no_pending_target()
        self._set_speed(speed_mm_per_s)
        self._check_reachable(target)
        self._unlock()
        self._line.write_unless_stopped(codec.command("MOV", codec.pose_values(target)))
        self._refuse_errors("move")
        self._check_target(target)

    def lock(self) -> None:
        """Brakes on, read back, then servos off, read back."""
        self._brake()
        self._line.write(SERVOS_OFF)
        servos = self._switches("SVO")
        if any(servos):
            on = [a for a, on in zip(AXES, servos, strict=True) if on]
            raise DeviceError(f"the robot does not lock: servos are still on on {on}; do not drill, switch it off")
        self._line.note_locked()
        error = self._asked_error()  # what came late is reported by `read`: it is not about the locking
        if error is not None and not error.is_stop:
            raise ControllerFault(f"locking the robot failed: {error.message}")

    def stop_now(self) -> DeviceError | None:
        """Stop and lock at once; see `HexapodController`."""
        return self._line.stop_now()

    def release_stop(self) -> None:
        """Let motion commands through again."""
        self._line.release_stop()

    def close(self) -> None:
        """Leave the line."""
        self._line.close()

    def _brake(self) -> None:
        """Brakes on; the servos must not go off before that is certain, or as certain as it can be."""
        self._line.write(BRAKES_ON)
        try:
            brakes = self._switches("BRA")
        except DeviceError:
            self._line.write(LOCK_UNCONFIRMED)  # it does not answer, but may hear
            raise
        if not all(brakes):
            off = [a for a, on in zip(AXES, brakes, strict=True) if not on]
            raise DeviceError(
                f"the robot does not lock: brakes are off on {off}, only the servos hold it; do not drill, support the "
                "guide and switch it off"
            )

    def _unlock(self) -> None:
        self._line.write_unless_stopped(SERVOS_ON)
        self._refuse_errors("switch the servos on")
        if not all(self._switches("SVO")):
            raise DeviceError("the servos do not switch on, so the brakes stay on; reset the controller")
        self._line.write_unless_stopped(BRAKES_OFF)
        self._refuse_errors("release the brakes")

    def _check_axes(self) -> None:
        axes = self._line.ask(codec.query("SAI"), partial(codec.parse_axis_names, question="SAI?"))
        if axes != AXES:
            raise DeviceError(
                f"the controller has the axes {' '.join(axes)}, a hexapod has {' '.join(AXES)}; check the URL"
            )

    def _check_syntax_version(self) -> None:
        version = self._line.ask(codec.query("CSV"), partial(codec.parse_number, question="CSV?"))
        if version != 2.0:
            raise DeviceError(f"the controller speaks GCS {version:g}, this driver speaks GCS 2.0; set its syntax to 2")

    def _set_pivot(self, hexapod: HexapodPart) -> None:
        wanted = tuple(float(v) for v in hexapod.pivot_mm)
        if not np.allclose(self._pivot(), wanted, rtol=0.0, atol=CONTROLLER_LINE.written_tolerance):
            self._line.write(codec.command("SPI", dict(zip(PIVOT_AXES, wanted, strict=True))))
            self._refuse_errors("set the pivot")
        found = self._pivot()
        if not np.allclose(found, wanted, rtol=0.0, atol=CONTROLLER_LINE.written_tolerance):
            raise DeviceError(f"the controller's pivot is {found} mm after setting it to {wanted} mm; set it by hand")

    def _pivot(self) -> tuple[float, ...]:
        parse = partial(codec.parse_axis_values, axes=PIVOT_AXES, question="SPI?")
        return self._line.ask(codec.query("SPI", PIVOT_AXES), parse)

    def _check_no_pending_target(self) -> None:
        # With the servo on, the robot goes to whatever target the controller still holds: it must be where it stands.
        off = deviation(self._pose("MOV"), self._pose("POS"))
        if off.exceeds(SUPERVISION.read_back):
            raise DeviceError(
                f"the controller holds a target {off} from where the robot stands (limits {SUPERVISION.read_back}) and "
                "would go there when unlocked; reset it"
            )

    def _set_speed(self, speed_mm_per_s: float) -> None:
        self._line.write(f"VLS {speed_mm_per_s:.6f}\n".encode("ascii"))
        self._refuse_errors("set the speed")
        found = self._line.ask(codec.query("VLS"), partial(codec.parse_number, question="VLS?"))
        if abs(found - speed_mm_per_s) > CONTROLLER_LINE.speed_tolerance_mm_per_s:
            raise DeviceError(f"the controller's speed is {found:g} mm/s after setting it to {speed_mm_per_s:g} mm/s")

    def _check_reachable(self, target: PlatformPose) -> None:
        question = codec.command("VMO?", codec.pose_values(target))
        if self._line.ask(question, partial(codec.parse_integer, question="VMO?")) != 1:
            raise DeviceError(
                "the controller cannot reach the target, by its own report; compare its limits with the hexapod file"
            )

    def _check_target(self, target: PlatformPose) -> None:
        taken = self._pose("MOV")
        apart = float(np.abs(taken.as_array() - target.as_array()).max())
        if apart <= CONTROLLER_LINE.written_tolerance:
            return
        try:
            self._refuse_errors("move")  # a stop or a fault between command and question explains it better
        finally:
            self.stop_now()
        raise DeviceError(
            f"the controller took the target {taken} for {target}, {apart:.6f} apart; it was stopped, check the cable"
        )

    def _refuse_errors(self, doing: str) -> None:
        error = self._error()
        if error is None:
            return
        if error.is_stop:
            raise StopInForce(f"could not {doing}: {error.message}")
        self.stop_now()
        raise ControllerFault(f"could not {doing}: {error.message}")

    def _error(self) -> ControllerError | None:
        late, self._late_error = self._late_error, None
        return late or self._asked_error()

    def _asked_error(self) -> ControllerError | None:
        # Never asked again when garbled: asking has cleared the error, and a lost error must not pass for none.
        try:
            return self._noted(self._line.ask_once(codec.query("ERR"), _code, self._take_late_error))
        except ReplyGarbled as lost:
            self._late_error = _lost_error(lost)
            raise

    def _take_late_error(self, reply: list[str]) -> None:
        try:
            self._late_error = self._noted(_code(reply))
        except ReplyGarbled as lost:
            self._late_error = _lost_error(lost)

    def _noted(self, code: int) -> ControllerError | None:
        error = controller_error(code)
        if error is not None and error.kind in _BUTTON_ERRORS:
            self._button_error = error
        return error

    def _pending_error(self) -> ControllerError | None:
        # A report of the button between two rounds of feedback must not be lost: some controllers give it only once.
        # A fault goes first, and the button waits for the next round; of two stops the button's explains more.
        error = self._error()
        if error is not None and not error.is_stop:
            return error
        button, self._button_error = self._button_error, None
        return button or error

    def _switches(self, name: str) -> tuple[bool, ...]:
        parse = partial(codec.parse_switches, axes=AXES, question=f"{name}?")
        return self._line.ask(codec.query(name, AXES), parse)

    def _confirm_at_rest(self, pose: PlatformPose) -> None:
        # Numbers carry no checksum: a digit that the line changed makes another number. Two changed alike are rare.
        again = self._pose("POS")
        off = deviation(pose, again)
        if off.exceeds(SUPERVISION.read_back):
            raise ReplyGarbled(
                f"the controller reported two positions of a robot at rest, {off} apart (limits "
                f"{SUPERVISION.read_back}); check the cable"
            )

    def _pose(self, name: str) -> PlatformPose:
        return self._line.ask(codec.query(name, AXES), partial(codec.parse_pose, question=f"{name}?"))


def _lost_error(lost: ReplyGarbled) -> ControllerError:
    return ControllerError(ErrorKind.FAULT, f"an error of the controller may be lost: {lost}")


def _code(reply: list[str]) -> int:
    return codec.parse_integer(reply, question="ERR?")
