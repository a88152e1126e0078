"""Pipes by which processes learn that the one that started them has ended, or hangs.

The other end of each pipe closes with this process, however it ends; nobody else holds it. While this process runs, a
byte comes twenty times a second: a robot service that nobody would start again must not go on moving.
"""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Final, Self

from shared.threads import supervised_thread

_BEAT_EVERY_S: Final = 0.05


class Lifelines:
    """One pipe for each process, by name. Use as a context manager."""

    def __init__(self) -> None:
        self._ends: dict[str, int] = {}
        self._changing = threading.Lock()
        self._ended = threading.Event()
        self._thread = supervised_thread("lifelines", self._beat)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        for end in self._ends.values():
            os.close(end)
        self._ends.clear()

    @contextmanager
    def handed_over(self, name: str) -> Iterator[int]:
        """The end that a process is to inherit while it is started; one that it had before is closed."""
        reads, writes = os.pipe()
        os.set_blocking(writes, False)
        with self._changing:
            before = self._ends.get(name)
            self._ends[name] = writes
        if before is not None:
            os.close(before)
        try:
            yield reads
        finally:
            os.close(reads)

    def _beat(self) -> None:
        while not self._ended.wait(_BEAT_EVERY_S):
            with self._changing:
                for end in self._ends.values():
                    with suppress(OSError):  # full, because that process hangs; or it has ended
                        os.write(end, b".")
