"""One thread per declaration of the in-memory bus, as Zenoh has one per callback; never the caller's own."""

import threading
from collections import deque
from collections.abc import Callable

import structlog

_BOUND = 1024
_log = structlog.get_logger("distalock.bus")


class Worker:
    """Runs tasks one after another on a thread of its own; drops the oldest when `_BOUND` are waiting."""

    def __init__(self, name: str) -> None:
        self._tasks: deque[Callable[[], None]] = deque(maxlen=_BOUND)
        self._changed = threading.Condition()
        self._closed = False
        threading.Thread(target=self._run, name=f"memory-bus {name}", daemon=True).start()

    def submit(self, task: Callable[[], None]) -> None:
        """Run later; too late when closed."""
        with self._changed:
            if not self._closed:
                self._tasks.append(task)
                self._changed.notify()

    def close(self) -> None:
        """Forget what waits and end the thread after the task that runs now."""
        with self._changed:
            self._closed = True
            self._tasks.clear()
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._tasks)
                if self._closed:
                    return
                task = self._tasks.popleft()
            _run_logged(task)


def _run_logged(task: Callable[[], None]) -> None:
    try:
        task()
    except Exception:  # noqa: BLE001 - the border of a task: a handler that raises must not end the bus's thread
        _log.exception("bus handler raised")
