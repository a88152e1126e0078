"""Rooms in which bus sessions meet, and helpers that wait on events."""

import itertools
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

from distalock.local_ports import free_ports
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus
from shared.bus.zenoh_bus import BusSettings, open_bus

PATIENCE_S = 60.0
T = TypeVar("T")
_numbers = itertools.count()


class Room(Protocol):
    """Where sessions of one implementation meet."""

    def open(self) -> AbstractContextManager[Bus]: ...
    def cut(self) -> None: ...
    def restore(self) -> None: ...


class MemoryRoom:
    def __init__(self, router: MemoryRouter) -> None:
        self._router = router

    def open(self) -> AbstractContextManager[Bus]:
        return self._router.open()

    def cut(self) -> None:
        self._router.cut()

    def restore(self) -> None:
        self._router.restore()


def free_port() -> int:
    (port,) = free_ports(1)
    return port


class RouterProcess:
    """`python -m shared.bus.router` on a free port."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()

    def start(self) -> None:
        command = [sys.executable, "-m", "shared.bus.router", "--plain-bus", "--listen", self.endpoint]
        self._process = subprocess.Popen(command)
        with open_bus(BusSettings(self.endpoint, PATIENCE_S)):
            pass

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)
        self.wait()

    def send_signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    def wait(self) -> int:
        assert self._process is not None
        return self._process.wait(PATIENCE_S)


class ZenohRoom:
    def __init__(self, router: RouterProcess) -> None:
        self._router = router

    def open(self) -> AbstractContextManager[Bus]:
        return open_bus(BusSettings(self._router.endpoint, PATIENCE_S))

    def cut(self) -> None:
        self._router.kill()

    def restore(self) -> None:
        self._router.start()


class Collector(Generic[T]):
    """Keeps what handlers receive and lets a test wait for it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.items: list[T] = []

    def add(self, item: T) -> None:
        with self._changed:
            self.items.append(item)
            self._changed.notify_all()

    def wait_for(self, item: T) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: item in self.items, PATIENCE_S), f"no {item!r} in {self.items!r}"

    def wait_until(self, count: int) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.items) >= count, PATIENCE_S), f"only {self.items!r}"

    def wait_for_last(self, item: T) -> None:
        with self._changed:
            arrived = self._changed.wait_for(lambda: self.items[-1:] == [item], PATIENCE_S)
            assert arrived, f"last is not {item!r}: {self.items!r}"


def until_known(declared_at: Bus, known_at: Bus) -> None:
    """Return when all that `declared_at` has declared is known at `known_at`: declarations travel in order."""
    key = f"sync/{next(_numbers)}"
    seen = threading.Event()
    watch = known_at.presence().watch_alive(key, lambda _key, alive: seen.set() if alive else None)
    token = declared_at.presence().declare_alive(key)
    assert seen.wait(PATIENCE_S), "a liveliness token did not arrive"
    token.close()
    watch.close()


def eventually(condition: Callable[[], bool]) -> None:
    """Return when a condition that nobody announces holds."""
    deadline = time.monotonic() + PATIENCE_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true"
        pause.wait(0.005)
