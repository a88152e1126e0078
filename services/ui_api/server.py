"""The HTTP server on a thread of its own: signals are the business of the main thread."""

import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI

from services.ui_api.slow_clients import HeadDeadlineProtocol
from shared.errors import ConfigurationError
from shared.threads import supervised_thread

_LEAVE_WITHIN_S = 3
_BACKLOG = 128


def listening_socket(host: str, port: int) -> socket.socket:
    """A socket that listens; who connects before the server runs, waits.

    Raises
    ------
    ConfigurationError
        When the port is in use or the address is not this machine's.
    """
    listening = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise ConfigurationError(
            f"the REST interface cannot listen on {host} port {port} ({error.strerror or error}); end the program "
            "that holds it, or choose another with DISTALOCK_UI_API_PORT"
        ) from None
    return listening


@contextmanager
def serving(
    app: FastAPI,
    listening: socket.socket,
    on_early_end: Callable[[], None],
    https: ssl.SSLContext | None = None,
) -> Iterator[None]:
    """Serve an application for as long as the context lasts; the socket is closed on leaving.

    Parameters
    ----------
    on_early_end
        Called, on the server's thread, when the server ends by itself.
    https
        None for HTTP without TLS.
    """
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=_LEAVE_WITHIN_S,
        ws_per_message_deflate=False,  # the pictures are compressed, and each viewer would have them compressed again
        http=HeadDeadlineProtocol,
        ssl_context_factory=None if https is None else lambda _config, _default: https,
        # Nobody is in front of this server whose word about the client's address or scheme would count.
        proxy_headers=False,
        server_header=False,
    )
    server = uvicorn.Server(config)

    def serve() -> None:
        server.run(sockets=[listening])
        if not server.should_exit:
            on_early_end()

    thread = supervised_thread("http", serve)
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join(_LEAVE_WITHIN_S + 2.0)
        listening.close()
