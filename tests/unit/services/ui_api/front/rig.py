"""A front with a robot that answers when told to, and an application that is a function."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

from services.ui_api.core.networks import PRIVATE_NETWORKS, Network
from services.ui_api.front.admission import Admission, Limits
from services.ui_api.front.application import ApplicationLink
from services.ui_api.front.application_socket import ApplicationConnections
from services.ui_api.front.connection import FrontParts
from services.ui_api.front.handover import Handover
from services.ui_api.front.port import listening_socket
from services.ui_api.front.server import FrontServer, serving_front
from services.ui_api.front.stops import FrontStops
from services.ui_api.handlers.stop import StopOutcome
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.link_messages import FROM_FRONT, StopEnded, StopRecorded
from shared.messages.robot import MotionState
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.served import unix_listening

STOP = b"POST /api/v1/robot/stop HTTP/1.1\r\nhost: g\r\n\r\n"
GET = b"GET /api/v1/cases HTTP/1.1\r\nhost: g\r\n\r\n"
Application = Callable[[socket.socket], None]


class FrontRig:
    """Everything around a front.

    Attributes
    ----------
    stopped
        One for each stop that went out.
    address
        Of the public port.
    """

    def __init__(
        self,
        stack: ExitStack,
        application: Application,
        limits: Limits,
        head_within_s: float,
        handover: Handover | None,
        room_networks: tuple[Network, ...],
        reads_within_s: float,
    ) -> None:
        self.stopped = threading.Semaphore(0)
        self.robot_answers = threading.Event()
        self.robot_answers.set()
        self.link = ApplicationLink()
        self.stops = FrontStops(StopSender(self._stop), self.link.tell)
        self.link.on_recorded = self.stops.note_recorded
        self.admission = Admission(limits)
        place, inner = unix_listening(stack)
        ours, self.its_end = (stack.enter_context(end) for end in socket.socketpair())
        outer = stack.enter_context(listening_socket("127.0.0.1", 0))
        self.address = outer.getsockname()
        parts = FrontParts(
            self.stops,
            self.admission,
            ApplicationConnections(place),
            "http",
            room_networks,
            handover,
            head_within_s,
            head_within_s,
            reads_within_s,
        )
        self.leaving = parts.leaving
        server = FrontServer(parts, self.link)
        accepting = threading.Thread(target=self._serve, args=(inner, application), daemon=True)
        accepting.start()
        # A thread that still waits here when the socket is closed waits for the next socket of the same number.
        stack.callback(accepting.join)
        stack.callback(inner.shutdown, socket.SHUT_RDWR)
        stack.enter_context(serving_front(server, outer, ours))

    def _stop(self, reason: str) -> StopOutcome:
        del reason
        self.stopped.release()
        assert self.robot_answers.wait(PATIENCE_S)
        return StopOutcome(confirmed=True, state=MotionState.STOPPED, message="")

    @staticmethod
    def _serve(listening: socket.socket, application: Application) -> None:
        with suppress(OSError):
            while True:
                connection, _ = listening.accept()
                threading.Thread(target=FrontRig._handle, args=(connection, application), daemon=True).start()

    @staticmethod
    def _handle(connection: socket.socket, application: Application) -> None:
        with connection, suppress(OSError):
            application(connection)

    def connect(self) -> socket.socket:
        connection = socket.create_connection(self.address, PATIENCE_S)
        connection.settimeout(PATIENCE_S)
        return connection

    def heard_by_application(self) -> Iterator[StopEnded]:
        """Stops that the application is to record."""
        self.its_end.settimeout(PATIENCE_S)
        for line in self.its_end.makefile("rb"):
            message = FROM_FRONT.validate_json(line)
            if isinstance(message, StopEnded):
                yield message

    def record(self, number: int) -> None:
        """Say as the application that a stop is on record."""
        self.its_end.sendall(StopRecorded(number=number).line())


def answer_of(connection: socket.socket) -> bytes:
    """One answer whose head says how long it is, and nothing of the next one."""
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += _piece(connection, 1)
    length = next(int(f.split(b":")[1]) for f in head.lower().split(b"\r\n") if f.startswith(b"content-length"))
    body = b""
    while len(body) < length:
        body += _piece(connection, length - len(body))
    return head + body


def _piece(connection: socket.socket, most_bytes: int) -> bytes:
    piece = connection.recv(most_bytes)
    assert piece, "the connection ended before the answer"
    return piece


@contextmanager
def front(
    application: Application,
    limits: Limits = Limits(connections=100, relays=50),  # noqa: B008 - frozen
    head_within_s: float = PATIENCE_S,
    handover: Handover | None = None,
    room_networks: tuple[Network, ...] = PRIVATE_NETWORKS,
    reads_within_s: float = PATIENCE_S,
) -> Iterator[FrontRig]:
    """A front on a free port for as long as the context lasts."""
    with ExitStack() as stack:
        yield FrontRig(stack, application, limits, head_within_s, handover, room_networks, reads_within_s)
