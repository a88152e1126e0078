"""What the front process and the application process say to each other, one JSON object a line."""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

# The application's beats; the front takes it for hung after `BEATS_WITHIN_S` without one. With the robot's own deadline
# of 0.2 s that ends a motion within 0.5 s.
BEAT_S: Final = 0.05
BEATS_WITHIN_S: Final = 0.25


class _Line(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    def line(self) -> bytes:
        """The message as it is sent."""
        return self.model_dump_json().encode() + b"\n"


class StopBegun(_Line):
    """The front has sent a stop: commands that wait to be sent are not sent any more."""

    kind: Literal["stop_begun"] = "stop_begun"


class StopEnded(_Line):
    """What came of a stop, to be recorded. `took_s` is the time to its answer."""

    kind: Literal["stop_ended"] = "stop_ended"
    number: int
    reason: str
    who: str
    confirmed: bool
    state: str | None
    message: str
    took_s: float


class FrontFigures(_Line):
    """How busy the front is, for the gateway's metrics, and what its process is short of, for `readyz`."""

    kind: Literal["figures"] = "figures"
    connections: int
    relays: int
    streams: int
    stops: int
    closed_idle: int
    refused: int
    lacking: str | None = None


class Beat(_Line):
    """The application is alive; so many connections that were handed to it stream."""

    kind: Literal["beat"] = "beat"
    streams: int = 0


class Listening(_Line):
    """The application takes requests."""

    kind: Literal["listening"] = "listening"


class StopRecorded(_Line):
    """A stop is on record."""

    kind: Literal["stop_recorded"] = "stop_recorded"
    number: int


FromFront = StopBegun | StopEnded | FrontFigures
FromApplication = Beat | Listening | StopRecorded
FROM_FRONT: Final[TypeAdapter[FromFront]] = TypeAdapter(Annotated[FromFront, Field(discriminator="kind")])
FROM_APPLICATION: Final[TypeAdapter[FromApplication]] = TypeAdapter(
    Annotated[FromApplication, Field(discriminator="kind")]
)
