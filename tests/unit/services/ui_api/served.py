"""A gateway behind its front, as its two processes are, here in one: two event loops, two sessions on the bus."""

import socket
import ssl
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from services.ui_api.app import make_app
from services.ui_api.application import FrontRecording
from services.ui_api.core.networks import PRIVATE_NETWORKS, Network
from services.ui_api.front.admission import Admission, Limits
from services.ui_api.front.application import ApplicationLink
from services.ui_api.front.application_socket import ApplicationConnections
from services.ui_api.front.connection import FrontParts
from services.ui_api.front.handover import Handover
from services.ui_api.front.port import listening_socket
from services.ui_api.front.server import FrontServer, serving_front
from services.ui_api.front.stops import FrontStops
from services.ui_api.front_link import FrontLink
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.server import serving
from services.ui_api.service import Gateway
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter

ROOMY = Limits(connections=1000, relays=250)


@contextmanager
def served(
    gateway: Gateway,
    router: MemoryRouter,
    keys: Keys,
    https: ssl.SSLContext | None = None,
    room_networks: tuple[Network, ...] = PRIVATE_NETWORKS,
    cors_origins: tuple[str, ...] = (),
) -> Iterator[str]:
    """Serve on a free port for as long as the context lasts; the address to call."""
    scheme = "http" if https is None else "https"
    with ExitStack() as stack:
        address, inner = unix_listening(stack)
        app = make_app(gateway, cors_origins=cors_origins)
        ours, its = (stack.enter_context(end) for end in socket.socketpair())
        link = ApplicationLink()
        stops = FrontStops(StopSender(StopHandler(stack.enter_context(router.open()), keys, "front").stop), link.tell)
        link.on_recorded = stops.note_recorded
        outer = stack.enter_context(listening_socket("127.0.0.1", 0))
        giving, taking = (stack.enter_context(end) for end in socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET))
        parts = FrontParts(
            stops,
            Admission(ROOMY),
            ApplicationConnections(address),
            scheme,
            room_networks,
            Handover(giving) if https is None else None,
        )
        stack.enter_context(serving(app, inner, lambda: None, taking))
        stack.enter_context(serving_front(FrontServer(parts, link, https), outer, ours))
        application = FrontLink(its, lambda: None)
        stack.enter_context(application.beating())
        application.listen(FrontRecording(gateway, app))
        stack.callback(gateway.feed.close)  # event streams end now, or the server would wait for them
        yield f"{scheme}://127.0.0.1:{outer.getsockname()[1]}"


def unix_listening(stack: ExitStack) -> tuple[Path, socket.socket]:
    """A socket that listens in a folder with a short name, and its address."""
    address = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="d-"))) / "s"
    listening = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    listening.bind(str(address))
    listening.listen()
    return address, listening
