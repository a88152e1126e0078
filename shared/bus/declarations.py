"""What a session has declared: kept until closed, and for what has a channel, served by a thread of its own."""

import threading
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

from shared.threads import report_error, supervised_thread

T_co = TypeVar("T_co", covariant=True)
T = TypeVar("T")


class Undeclarable(Protocol):
    """Anything that can be declared on a session."""

    def undeclare(self) -> None:
        """Take it back."""


class Channel(Undeclarable, Iterable[T_co], Protocol[T_co]):
    """A declaration with a channel: iterating waits for the next item and ends when it is undeclared."""


class Declared:
    """A declaration that lasts until closed, whether the caller keeps it or not. Closing it twice is harmless.

    Parameters
    ----------
    declared
        The session's own object; Zenoh undeclares it as soon as nobody refers to it.
    kept
        Where the session keeps what is open.
    """

    def __init__(self, declared: Undeclarable, kept: "set[Declared]") -> None:
        self._declared = declared
        self._kept = kept
        self._lock = threading.Lock()
        kept.add(self)

    def close(self) -> None:
        """Take it back."""
        with self._lock:
            was_open = self in self._kept
            self._kept.discard(self)
        if was_open:
            self._declared.undeclare()


def pump(channel: Channel[T], handle: Callable[[T], None], name: str) -> threading.Thread:
    """Hand every item to `handle` on a thread of its own, which is returned, until the channel is undeclared.

    A handler that raises is reported, and the next item is handled all the same; a channel that raises is a fault.
    """

    def run() -> None:
        for item in channel:
            try:
                handle(item)
            except Exception as error:  # noqa: BLE001 - the border of a task
                report_error(f"bus handler of '{name}'", error)
            del item  # or it would keep its place in shared memory until the next one comes

    thread = supervised_thread(f"bus {name}", run)
    thread.start()
    return thread
