"""Which request a log line belongs to: W3C trace context, from REST over the bus to whoever carries it out.

A trace is bound to the thread or task that works for it (`traced`). Log lines name it as `trace_id`, questions on the
bus carry it as their attachment. Threads that work for a request later take it along with `carried`.
"""

import contextvars
import random
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, ParamSpec, TypeVar

from structlog.contextvars import bind_contextvars, get_contextvars, reset_contextvars

P = ParamSpec("P")
R = TypeVar("R")

TRACEPARENT: Final = "traceparent"
_TRACE_ID: Final = "trace_id"
# https://www.w3.org/TR/trace-context/: version, trace, span, flags; ids of zeros and version ff are invalid.
_WELL_FORMED: Final = re.compile(r"(?!ff)[0-9a-f]{2}-(?!0{32})([0-9a-f]{32})-(?!0{16})[0-9a-f]{16}-([0-9a-f]{2})(-.*)?")
_VERSION, _SAMPLED = "00", "01"
# Seeded by the system once: an id is no secret, and asking the system for each took a twentieth of a request's time.
_ids: Final = random.Random()


def trace_id_of(traceparent: str) -> str | None:
    """The trace that a header names; None when it is none."""
    found = _WELL_FORMED.fullmatch(traceparent)
    if found is None or (traceparent.startswith(_VERSION) and found[3] is not None):
        return None
    return found[1]


def new_trace_id() -> str:
    """An id that nobody else has."""
    return f"{_ids.getrandbits(128):032x}"


def current_traceparent() -> str | None:
    """Header of what is worked for here, with a span of its own; None where nothing was asked for."""
    trace_id = get_contextvars().get(_TRACE_ID)
    return None if trace_id is None else traceparent_of(trace_id)


def traceparent_of(trace_id: str) -> str:
    """Header of a trace, with a span of its own."""
    return f"{_VERSION}-{trace_id}-{_ids.getrandbits(64):016x}-{_SAMPLED}"


@contextmanager
def traced(trace_id: str | None, **names: str) -> Iterator[None]:
    """Work for a trace for as long as the context lasts; log lines name it and what else is given."""
    bound = names if trace_id is None else names | {_TRACE_ID: trace_id}
    before = bind_contextvars(**bound)
    try:
        yield
    finally:
        reset_contextvars(**before)


def carried(work: Callable[P, R]) -> Callable[P, R]:
    """The same for another thread, where it works for the trace that is worked for here and now."""
    context = contextvars.copy_context()

    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        return context.run(work, *args, **kwargs)

    return run
