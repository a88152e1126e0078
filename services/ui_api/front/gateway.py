"""The gateway's processes, put together: the front in this one, the application in one of its own."""

import socket
import ssl
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Final

from services.ui_api.front.admission import Admission, Limits, raised_handle_limit
from services.ui_api.front.application import ApplicationLink, running_application
from services.ui_api.front.application_socket import ApplicationConnections
from services.ui_api.front.connection import FrontParts
from services.ui_api.front.handover import Handover
from services.ui_api.front.server import FrontServer, serving_front
from services.ui_api.front.stops import FrontStops
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.settings import UiApiSettings
from shared.bus.port import Bus
from shared.hosts import PLAIN_HTTP_WARNING, is_loopback
from shared.runtime.lifecycle import Runtime, living, run_service
from shared.runtime.settings import ServiceSettings

# With these the application has said itself, in one sentence, why it ended: see `run_service`.
_EXPLAINED: Final = frozenset((1, 2))


def run_gateway(settings: UiApiSettings, listening: socket.socket, https: ssl.SSLContext | None) -> int:
    """Run the gateway until a signal, a fault, or the end of its application; the exit code. TLS ends in the front."""
    gateway = _Gateway(settings, listening, https, raised_handle_limit())
    code = run_service("ui_api", _logging_apart(settings), gateway.compose, showing=gateway.showing)
    return code or gateway.explained_code


class _Gateway:
    """Composes the front for `run_service`.

    Attributes
    ----------
    explained_code
        The application's exit code, when it ended by itself and said why; otherwise 0.
    """

    def __init__(
        self, settings: UiApiSettings, listening: socket.socket, https: ssl.SSLContext | None, handles: int
    ) -> None:
        self._settings, self._listening, self._https, self._handles = settings, listening, https, handles
        self._link = ApplicationLink()
        self.explained_code = 0

    def showing(self, bus: Bus, runtime: Runtime, _: ServiceSettings) -> AbstractContextManager[None]:
        """Token and heartbeats; how the gateway fares is for the application to say."""
        return living(bus, runtime, self._link.is_alive)

    @contextmanager
    def compose(self, bus: Bus, runtime: Runtime) -> Iterator[None]:
        """Run application and port for as long as the context lasts."""
        handler = StopHandler(bus, runtime.keys, f"gateway-{runtime.boot_epoch[:12]}")
        stops = FrontStops(StopSender(handler.stop), self._link.tell)
        self._link.on_recorded = stops.note_recorded
        arguments = ("--boot-epoch", runtime.boot_epoch, "--state-dir", str(self._settings.state_dir))
        with running_application(arguments, lambda code: self._on_end(code, runtime)) as application:
            scheme = "http" if self._https is None else "https"
            handover = Handover(application.streams) if self._https is None else None
            admission = Admission(Limits.of(self._handles))
            self._link.on_streams = admission.note_streams
            connections = ApplicationConnections(application.address)
            parts = FrontParts(stops, admission, connections, scheme, self._settings.room_networks, handover)
            with serving_front(FrontServer(parts, self._link, self._https), self._listening, application.line):
                self._announce(runtime)
                yield
                self._link.leave()  # before the application, which may take seconds: nothing moves meanwhile
                parts.leaving.begin()
                application.end()  # before the port: requests under way are still answered, and stops go out

    def _announce(self, runtime: Runtime) -> None:
        runtime.log.info("listening", address=self._listening.getsockname(), https=self._https is not None)
        if self._https is None and not is_loopback(self._settings.host):
            runtime.log.warning("plain_http", detail=PLAIN_HTTP_WARNING)

    def _on_end(self, code: int, runtime: Runtime) -> None:
        """The application has ended by itself. Without its beats the gateway's heartbeats end: motion stops."""
        if code in _EXPLAINED:
            self.explained_code = code
            runtime.log.error("application_ended", code=code)
            runtime.stop.set()
        else:
            runtime.fail(f"the application process ended with code {code}")


def _logging_apart(settings: UiApiSettings) -> UiApiSettings:
    """The front's log file: two processes cannot rotate one."""
    if settings.log_file is None:
        return settings
    return settings.model_copy(update={"log_file": settings.log_file.with_stem(f"{settings.log_file.stem}-front")})
