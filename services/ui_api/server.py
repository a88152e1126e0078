"""The HTTP servers on threads of their own: signals are the business of the main thread.

Requests have one event loop, and what streams another: fifty viewers fill the one with a hundred messages for each
picture, and a request would wait until the last of them is sent.
"""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI

from services.ui_api.handed_server import HandedServer
from services.ui_api.inner.protocol import InnerProtocol
from services.ui_api.inner.websocket import InnerWebSocket
from shared.threads import supervised_thread

# Chosen: requests under way end within it; then their connections are closed.
_LEAVE_WITHIN_S = 3


@contextmanager
def serving(
    app: FastAPI,
    listening: socket.socket,
    on_early_end: Callable[[], None],
    handed_on: socket.socket | None = None,
) -> Iterator[Callable[[], int]]:
    """Serve an application for as long as the context lasts; tells how many connections stream.

    The socket is closed on leaving.

    Parameters
    ----------
    on_early_end
        Called, on a server's thread, when it ends by itself.
    handed_on
        Where the front hands over connections that stream.
    """
    requests = uvicorn.Server(_config(app))
    servers = [requests]
    threads = [supervised_thread("http", _work(requests, [listening], on_early_end))]
    streams = None if handed_on is None else HandedServer(_config(app), handed_on)
    if streams is not None:
        servers.append(streams)
        threads.append(supervised_thread("streams", _work(streams, [], on_early_end)))
    for thread in threads:
        thread.start()
    try:
        yield lambda: 0 if streams is None else streams.streams
    finally:
        for server in servers:
            server.should_exit = True
        gone_by_s = time.monotonic() + _LEAVE_WITHIN_S + 2.0
        for thread in threads:
            thread.join(max(gone_by_s - time.monotonic(), 0.0))
        listening.close()


def _work(server: uvicorn.Server, sockets: list[socket.socket], on_early_end: Callable[[], None]) -> Callable[[], None]:
    def serve() -> None:
        server.run(sockets=sockets)
        if not server.should_exit:
            on_early_end()

    return serve


def _config(app: FastAPI) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=_LEAVE_WITHIN_S,
        proxy_headers=False,  # who sends, these protocols take from the front's word themselves
        ws_per_message_deflate=False,  # the pictures are compressed, and each viewer would have them compressed again
        http=InnerProtocol,  # the front has read the request: one parser decides what it is
        ws=InnerWebSocket,
        server_header=False,
    )
