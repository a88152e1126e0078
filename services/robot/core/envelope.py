"""At most once, and never late: what every command must pass before it may have an effect.

A query that timed out at its caller can be delivered seconds later. Clocks of different hosts do not compare, so
lateness is measured by the robot's clock alone: a command quotes the newest `RobotState` its client has seen, and is
refused when the robot published that state longer ago than the command's time to live, or when a stop has come since:
whoever asked did not know of it.
"""

from collections import OrderedDict, deque
from dataclasses import dataclass

from services.robot.core.refusals import Refusal, RefusalCode, refusal

# Bounds on memory: more commands and clients than a case has, and fifteen seconds of states in motion, where a command
# lives two at most.
REMEMBERED_COMMANDS = 4096
REMEMBERED_CLIENTS = 256
REMEMBERED_STATES = 512


@dataclass(frozen=True, slots=True)
class Envelope:
    """What a command carries.

    Attributes
    ----------
    effect
        What the command would do, in a form that compares (verb and plan hash): an id must not be used again for
        another effect.
    """

    command_id: str
    client: str
    client_sequence: int
    robot_boot_epoch: str
    after_state_sequence: int
    time_to_live_s: float
    effect: str


@dataclass(frozen=True, slots=True)
class Admitted:
    """The command may take effect now; it is on record already."""


@dataclass(frozen=True, slots=True)
class Repeat:
    """The command was answered before: give the same answer again."""

    answer: bytes


@dataclass(slots=True)
class _Record:
    effect: str
    answer: bytes | None = None


class CommandLedger:
    """Remembers commands and published states. Not thread-safe: the caller holds a lock.

    A command that has fallen out of the record cannot take effect again: by then its state has expired too.
    """

    def __init__(self, boot_epoch: str) -> None:
        self.boot_epoch = boot_epoch
        self._records: OrderedDict[str, _Record] = OrderedDict()
        self._newest_sequence: OrderedDict[str, int] = OrderedDict()
        self._published: deque[tuple[int, float]] = deque(maxlen=REMEMBERED_STATES)
        self._published_stops = 0
        self._first_since_stop = 0

    def note_published(self, sequence: int, now_s: float, stops: int) -> None:
        """A state with this sequence number goes out now; `stops` had come before it."""
        self._published.append((sequence, now_s))
        if stops != self._published_stops:
            self._published_stops, self._first_since_stop = stops, sequence

    @property
    def newest_state(self) -> int | None:
        """Number of the newest published state; None before the first."""
        return self._published[-1][0] if self._published else None

    @property
    def first_since_stop(self) -> int:
        """Number of the first state that was published after the last stop."""
        return self._first_since_stop

    def published_s(self, sequence: int) -> float | None:
        """When a state was published; None when that is out of record, or never happened."""
        return next((at_s for number, at_s in reversed(self._published) if number == sequence), None)

    def admit(self, envelope: Envelope, now_s: float, stops: int) -> Admitted | Repeat | Refusal:
        """Decide on a command when `stops` have come, and record its id before anything can come of it."""
        record = self._records.get(envelope.command_id)
        if record is not None:
            return _answer_to_repeat(envelope, record)
        refusal = self._refusal(envelope, now_s) or self._stopped_since(envelope, stops)
        if refusal is not None:
            return refusal
        self._remember(envelope)
        return Admitted()

    def answered(self, command_id: str, answer: bytes) -> None:
        """Keep the answer of an admitted command for its repeats."""
        self._records[command_id].answer = answer

    def _refusal(self, envelope: Envelope, now_s: float) -> Refusal | None:
        if envelope.robot_boot_epoch != self.boot_epoch:
            return refusal(
                RefusalCode.WRONG_BOOT_EPOCH,
                f"the command is for boot '{envelope.robot_boot_epoch}' of the robot service, this is boot "
                f"'{self.boot_epoch}'",
            )
        newest = self._newest_sequence.get(envelope.client, -1)
        if envelope.client_sequence <= newest:
            return refusal(
                RefusalCode.COMMAND_OUT_OF_ORDER,
                f"command {envelope.client_sequence} of '{envelope.client}' comes after its command {newest}",
            )
        return self._lateness(envelope, now_s)

    def _lateness(self, envelope: Envelope, now_s: float) -> Refusal | None:
        quoted = envelope.after_state_sequence
        if self.newest_state is None or quoted > self.newest_state:
            return refusal(
                RefusalCode.STATE_NOT_PUBLISHED,
                f"the command quotes state {quoted}, which the robot has not published",
            )
        published_s = self.published_s(quoted)
        age = "is out of record" if published_s is None else f"is {now_s - published_s:.2f} s old"
        if published_s is not None and now_s - published_s <= envelope.time_to_live_s:
            return None
        return refusal(
            RefusalCode.COMMAND_EXPIRED,
            f"the command quotes state {quoted}, which {age}, its time to live is {envelope.time_to_live_s:g} s; "
            "it came too late and was not carried out",
        )

    def _stopped_since(self, envelope: Envelope, stops: int) -> Refusal | None:
        quoted = envelope.after_state_sequence
        if stops == self._published_stops and quoted >= self._first_since_stop:
            return None
        return refusal(
            RefusalCode.STOPPED_SINCE,
            f"the command quotes state {quoted}, and a stop has come since; it was not carried out",
        )

    def _remember(self, envelope: Envelope) -> None:
        self._records[envelope.command_id] = _Record(envelope.effect)
        self._newest_sequence[envelope.client] = envelope.client_sequence
        self._newest_sequence.move_to_end(envelope.client)
        while len(self._records) > REMEMBERED_COMMANDS:
            self._records.popitem(last=False)
        while len(self._newest_sequence) > REMEMBERED_CLIENTS:
            self._newest_sequence.popitem(last=False)


def _answer_to_repeat(envelope: Envelope, record: _Record) -> Repeat | Refusal:
    if record.effect != envelope.effect:
        return refusal(
            RefusalCode.COMMAND_ID_REUSED,
            f"command id '{envelope.command_id}' was used for another command",
        )
    if record.answer is None:
        return refusal(
            RefusalCode.OUTCOME_UNKNOWN,
            f"command '{envelope.command_id}' is being decided on",
        )
    return Repeat(record.answer)
