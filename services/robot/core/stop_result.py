"""What is known after a stop: whether it was written, and what the controller has shown since. Pure."""

from dataclasses import dataclass

REMEDY = "press the stop button on the controller"


@dataclass(frozen=True, slots=True)
class SentStop:
    """A stop as it went out.

    Attributes
    ----------
    number
        Its place among all stops of this service.
    not_written
        Why its bytes could not be handed to the line; empty when they were.
    """

    number: int
    not_written: str = ""


@dataclass(frozen=True, slots=True)
class Readback:
    """One complete round of the controller's answers.

    Attributes
    ----------
    stops
        How many stops had been sent before its first question was asked.
    standstill
        Nothing moves.
    locked
        Brakes on and servos off.
    """

    stops: int
    standstill: bool
    locked: bool


@dataclass(frozen=True, slots=True)
class StopResult:
    """What became of a stop; `standstill` and `locked` are None while the controller has not answered since.

    Attributes
    ----------
    message
        One sentence when it is not confirmed: what is known, and what to do.
    """

    written: bool
    standstill: bool | None
    locked: bool | None
    message: str

    @property
    def confirmed(self) -> bool:
        """Written, at a standstill, and locked."""
        return self.written and self.standstill is True and self.locked is True


def stop_result(sent: SentStop, readback: Readback | None, detail: str) -> StopResult:
    """What is known of a stop from the newest readback.

    Parameters
    ----------
    readback
        None when there was none yet.
    detail
        What the drive says of the present state.
    """
    since = readback if readback is not None and readback.stops >= sent.number else None
    result = StopResult(
        written=not sent.not_written,
        standstill=None if since is None else since.standstill,
        locked=None if since is None else since.locked,
        message="",
    )
    if result.confirmed:
        return result
    return StopResult(result.written, result.standstill, result.locked, _message(sent, since, detail))


def _message(sent: SentStop, since: Readback | None, detail: str) -> str:
    written = f"the stop was not written ({sent.not_written})" if sent.not_written else "the stop was written"
    if since is None:
        shown = "the controller has not shown since that the robot is at rest and locked"
    else:
        moving = "is at rest" if since.standstill else "still moves"
        shown = f"the controller shows that the robot {moving} and {'is' if since.locked else 'is not'} locked"
    return f"{written}; {shown}; {REMEDY} (robot: {detail})"
