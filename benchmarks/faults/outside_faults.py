"""Faults from outside: the hexapod's controller and its line, the host's clock, port probes, a storm of images."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Final

from benchmarks.faults.image_storm import ImageSender
from benchmarks.faults.site import FaultSite
from shared.threads import supervised_thread

_PROBE_EVERY_S: Final = 0.05
_STORM_IMAGES_PER_S: Final = 30.0


def controller_silent() -> Callable[[FaultSite], AbstractContextManager[None]]:
    """The controller neither hears nor answers; a move under way goes on."""

    @contextmanager
    def inject(site: FaultSite) -> Iterator[None]:
        site.room.control.post("/faults", {"kind": "controller", "name": "silence"})
        try:
            yield
        finally:
            site.room.control.delete("/faults/controller/silence")

    return inject


@contextmanager
def line_cut(site: FaultSite) -> Iterator[None]:
    """The connection to the controller ends, and there is no new one."""
    site.line.cut()
    try:
        yield
    finally:
        site.line.mend()


def clock_stepped(ahead_s: float) -> Callable[[FaultSite], AbstractContextManager[None]]:
    """The host's wall clock is set; and set back when the fault goes."""

    @contextmanager
    def inject(site: FaultSite) -> Iterator[None]:
        site.clock.step_to(ahead_s)
        try:
            yield
        finally:
            site.clock.step_to(0.0)

    return inject


def ports_probed(site: FaultSite) -> AbstractContextManager[None]:
    """Connections to every port of the installation, forty a second, closed at once or left open without a word."""
    ports = site.room.installation.ports

    def probe(left_open: list[socket.socket]) -> None:
        for port in (ports.dicom, ports.rest, ports.router):
            with suppress(OSError):
                left_open.append(socket.create_connection(("127.0.0.1", port), timeout=1.0))
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()

    return _repeated(probe)


def image_storm(site: FaultSite) -> AbstractContextManager[None]:
    """Thirty images a second from another C-arm; each that is acknowledged has to be on record."""
    return ImageSender(site, _STORM_IMAGES_PER_S).sending()


@contextmanager
def _repeated(probe: Callable[[list[socket.socket]], None]) -> Iterator[None]:
    ended = threading.Event()
    left_open: list[socket.socket] = []

    def repeat() -> None:
        while not ended.wait(_PROBE_EVERY_S):
            probe(left_open)

    thread = supervised_thread("port probes", repeat)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        for one in left_open:
            one.close()
