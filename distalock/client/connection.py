"""What both clients know of HTTP connections."""

from typing import Final

import httpx

from distalock.client.answer import RawAnswer

ACCEPT_EVENTS: Final = {"Accept": "text/event-stream"}
# Chosen: a gateway that starts again is there after seconds.
RECONNECT_AFTER_S: Final = 1.0
_CONNECT_S: Final = 30.0
# The gateway says something at least every 10 s: a comment, when there is no event.
_SILENCE_S: Final = 30.0
STREAM_TIMEOUT: Final = httpx.Timeout(_SILENCE_S, connect=_CONNECT_S)


def timeout(answer_s: float) -> httpx.Timeout:
    """How long to wait for an answer, and for a connection."""
    return httpx.Timeout(answer_s, connect=_CONNECT_S)


def raw_answer(response: httpx.Response) -> RawAnswer:
    """An answer without the library that brought it."""
    return RawAnswer(
        response.status_code, {name.lower(): value for name, value in response.headers.items()}, response.content
    )


def require_place(after: int | None) -> None:
    """Where to go on with a stream that broke; raises `httpx.ReadError` when nobody knows."""
    if after is None:
        raise httpx.ReadError(
            "the stream of events broke before the first one; begin anew, with `after` where it counts"
        )
