"""One thread per declaration of the in-memory bus, as Zenoh has one per callback; never the caller's own."""

import threading
from collections import deque
from collections.abc import Callable

from shared.threads import report_error, supervised_thread

# Chosen: a bound on memory; who is this far behind has long been noticed.
_BOUND = 1024


class Worker:
    """Runs tasks one after another on a thread of its own; drops the oldest when `_BOUND` are waiting."""

    def __init__(self, name: str) -> None:
        self._tasks: deque[Callable[[], None]] = deque(maxlen=_BOUND)
        self._changed = threading.Condition()
        self._closed = False
        self._name = name
        supervised_thread(f"memory-bus {name}", self._run).start()

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
            try:
                task()
            except Exception as error:  # noqa: BLE001 - the border of a task: it must not end the bus's thread
                report_error(f"bus handler of '{self._name}'", error)
