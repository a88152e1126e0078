"""Who is alive as one session sees it: tokens count only while the link is there."""

import threading
from collections.abc import Callable

from shared.threads import report_error


class AliveView:
    """Merges what is known of tokens with the state of the link, and tells of changes only.

    Zenoh takes others' tokens away when the link is lost, but not always the session's own.

    Parameters
    ----------
    handler
        Called with (key, alive) on every change, one call at a time.
    """

    def __init__(self, handler: Callable[[str, bool], None]) -> None:
        self._handler = handler
        self._lock = threading.Lock()
        self._link_up = True
        self._tokens: set[str] = set()
        self._told: set[str] = set()

    def on_token(self, key: str, *, alive: bool) -> None:
        """A token appeared or vanished."""
        with self._lock:
            if alive:
                self._tokens.add(key)
            else:
                self._tokens.discard(key)
            self._tell_changes()

    def on_link(self, *, up: bool) -> None:
        """The link to the router was lost or came back."""
        with self._lock:
            self._link_up = up
            self._tell_changes()

    def _tell_changes(self) -> None:
        alive = self._tokens if self._link_up else set()
        gone, new = self._told - alive, alive - self._told
        self._told = set(alive)
        for key in sorted(gone | new):
            try:
                self._handler(key, key in new)
            except Exception as error:  # noqa: BLE001 - the other tokens' news must arrive all the same
                report_error(f"bus handler of '{key}'", error)
