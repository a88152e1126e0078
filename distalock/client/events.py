"""Server-sent events: bytes in, events out. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from pydantic import TypeAdapter, ValidationError

from distalock.client.base import ReceivedModel
from distalock.client.event_models import DATA_OF_KIND, EventData
from distalock.client.refusals import AnswerInvalid


class _Head(ReceivedModel):
    """What every event has, whatever its kind."""

    sequence: int
    at_ns: int
    case_id: str | None
    kind: str
    who: str
    why: str
    data: dict[str, object]


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the log.

    Attributes
    ----------
    data
        As its kind says; of a kind that this client does not know, the JSON object as it came.
    """

    sequence: int
    at_ns: int
    case_id: str | None
    kind: str
    who: str
    why: str
    data: EventData | dict[str, object]

    @staticmethod
    def of_json(text: str) -> "Event":
        """From the text that was sent; raises `AnswerInvalid`."""
        try:
            head = _Head.model_validate_json(text)
            kind = DATA_OF_KIND.get(head.kind)
            data = head.data if kind is None else TypeAdapter[EventData](kind).validate_python(head.data)
        except ValidationError as error:
            raise AnswerInvalid("GET", "events", error) from error
        return Event(head.sequence, head.at_ns, head.case_id, head.kind, head.who, head.why, data)


@dataclass(slots=True)
class EventLines:
    """Puts lines together to events, as the standard on server-sent events says; comments keep the line alive.

    Lines end with a line feed, as the gateway ends them: a text may hold U+2028 and others, at which `httpx` splits.
    """

    _begun: bytes = b""
    _data: list[str] = field(default_factory=list)

    def received(self, chunk: bytes) -> Iterator[Event]:
        """The events that end with these bytes."""
        *lines, self._begun = (self._begun + chunk).split(b"\n")
        for line in lines:
            yield from self._ended(line.decode(errors="replace").removesuffix("\r"))

    def _ended(self, line: str) -> Iterator[Event]:
        if line:
            name, _, value = line.partition(":")
            if name == "data":
                self._data.append(value.removeprefix(" "))
        elif self._data:
            text = "\n".join(self._data)
            self._data.clear()
            yield Event.of_json(text)
