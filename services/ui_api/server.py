"""The HTTP server on a thread of its own: signals are the business of the main thread."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI

from services.ui_api.handed_server import HandedServer
from shared.threads import supervised_thread

# Chosen: requests under way end within it; then their connections are closed.
_LEAVE_WITHIN_S = 3
# Longer than the front keeps a connection that waits for its next request (`front.application_socket`).
_KEEP_FOR_S = 10


@contextmanager
def serving(
    app: FastAPI,
    listening: socket.socket,
    on_early_end: Callable[[], None],
    handed_on: socket.socket | None = None,
) -> Iterator[HandedServer]:
    """Serve an application for as long as the context lasts; the socket is closed on leaving.

    Parameters
    ----------
    on_early_end
        Called, on the server's thread, when the server ends by itself.
    handed_on
        Where the front hands over connections that stream.
    """
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=_LEAVE_WITHIN_S,
        timeout_keep_alive=_KEEP_FOR_S,
        forwarded_allow_ips="*",  # nobody but the front reaches this server
        ws_per_message_deflate=False,  # the pictures are compressed, and each viewer would have them compressed again
        http="h11",  # as strict as the front, which has read the request before
        server_header=False,
    )
    server = HandedServer(config, handed_on)

    def serve() -> None:
        server.run(sockets=[listening])
        if not server.should_exit:
            on_early_end()

    thread = supervised_thread("http", serve)
    thread.start()
    try:
        yield server
    finally:
        server.should_exit = True
        thread.join(_LEAVE_WITHIN_S + 2.0)
        listening.close()
