"""Error codes of GCS 2.0, as they come in answer to `ERR?`, in neutral terms."""

from services.robot.core.controller_feedback import ControllerError, ErrorKind

# GCS 2.0 (docs/gcs.md): stopped by command; the controller's stop button pressed, and released again.
_STOPPED_BY_COMMAND, _STOP_BUTTON, _STOP_BUTTON_RELEASED = 10, 500, 501
_KINDS = {
    _STOPPED_BY_COMMAND: ErrorKind.STOPPED_BY_COMMAND,
    _STOP_BUTTON: ErrorKind.STOP_BUTTON_PRESSED,
    _STOP_BUTTON_RELEASED: ErrorKind.STOP_BUTTON_RELEASED,
}
_SENTENCES = {
    1: "the controller did not understand a command (syntax); the line may be disturbed, check cable and shielding",
    2: "the controller does not know a command; check that it is a GCS 2.0 hexapod controller",
    5: "an axis is not referenced or its servo is off; reset and reference again",
    7: "a target is outside the controller's limits; compare its limits with the hexapod file",
    8: "a velocity is outside the controller's limits; compare its limits with the hexapod file",
    9: "the pivot cannot be changed while the platform is turned; drive it to U V W = 0 with the maker's program",
    _STOPPED_BY_COMMAND: "the controller was stopped by a command",
    _STOP_BUTTON: "the controller's stop button is pressed; find out why, release it, then acknowledge the stop",
    _STOP_BUTTON_RELEASED: "the controller's stop button was pressed and is released; find out why, then acknowledge "
    "the stop",
    216: "a leg has met its limit switch; drive it free with the maker's program, reset and reference again",
    -1024: "a leg does not follow (motion error): something holds the robot; free it, reset and reference again",
}


def controller_error(code: int) -> ControllerError | None:
    """An error by its code; None for 0, which means none."""
    if code == 0:
        return None
    sentence = _SENTENCES.get(code, f"the controller reports error {code}; see its manual, then reset")
    return ControllerError(_KINDS.get(code, ErrorKind.FAULT), sentence)
