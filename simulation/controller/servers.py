"""The controller's wires: a TCP port and a pseudo-terminal. Both may serve one controller at the same time."""

import os
import queue
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from shared.errors import ConfigurationError
from shared.threads import supervised_thread
from simulation.controller.gcs_protocol import Assembler
from simulation.controller.line_rate import LineRate
from simulation.controller.virtual_controller import VirtualController

MOST_CLIENTS = 4
_RECEIVE_BYTES = 4096
_SEND_WITHIN_S = 2.0
_END_WITHIN_S = 5.0
_ACCEPT_AGAIN_AFTER_S = 0.05


@contextmanager
def tcp_server(
    controller: VirtualController, host: str = "127.0.0.1", port: int = 0, baud: int | None = None
) -> Iterator[int]:
    """Serve GCS on a TCP port for as long as the context lasts; yields the port (chosen freely when 0 was asked).

    At most `MOST_CLIENTS` are served at a time; further ones are hung up on. With `baud`, bytes take the time that they
    take on a serial line behind the port.

    Raises
    ------
    ConfigurationError
        When the port is in use or cannot be had.
    """
    try:
        listener = socket.create_server((host, port))
    except OSError as error:
        raise ConfigurationError(
            f"the virtual controller cannot listen at {host}:{port}: {_cause(error)}; "
            "stop the program that uses the port, or choose another"
        ) from error
    server = _TcpServer(controller, listener, baud)
    accepting = supervised_thread("gcs tcp", server.accept_until_closed)
    accepting.start()
    try:
        yield listener.getsockname()[1]
    finally:
        server.close()
        accepting.join(_END_WITHIN_S)


@contextmanager
def terminal_server(controller: VirtualController, baud: int | None = None) -> Iterator[str]:
    """Serve GCS on a pseudo-terminal for as long as the context lasts; yields its path, such as ``/dev/pts/3``.

    With `baud`, bytes take the time that they take on a serial line.
    """
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    ending = threading.Event()

    def read() -> bytes:
        received = os.read(ours, _RECEIVE_BYTES)
        return b"" if ending.is_set() else received

    def write(reply: bytes) -> None:
        _write_all(ours, reply)

    serving = supervised_thread("gcs pty", lambda: _converse(controller, read, write, baud))
    serving.start()
    try:
        # We keep the other end open too: otherwise reading fails as soon as a client closes it.
        yield os.ttyname(theirs)
    finally:
        ending.set()
        os.write(theirs, b"\n")  # wakes the reader
        serving.join(_END_WITHIN_S)
        os.close(theirs)
        os.close(ours)


class _TcpServer:
    """Accepts clients and serves each on a thread of its own."""

    def __init__(self, controller: VirtualController, listener: socket.socket, baud: int | None) -> None:
        self._controller = controller
        self._baud = baud
        self._listener = listener
        self._lock = threading.Lock()
        self._clients: dict[socket.socket, threading.Thread] = {}
        self._closing = threading.Event()

    def accept_until_closed(self) -> None:
        while not self._closing.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:  # closing, or a client that was gone before it was accepted
                self._closing.wait(_ACCEPT_AGAIN_AFTER_S)
            else:
                self._admit(client)

    def close(self) -> None:
        self._closing.set()
        with suppress(OSError):  # not every system lets a listener be shut down; closing it is what counts
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            clients = dict(self._clients)
        for client, serving in clients.items():
            with suppress(OSError):  # the client may have hung up by itself
                client.shutdown(socket.SHUT_RDWR)
            serving.join(_END_WITHIN_S)

    def _admit(self, client: socket.socket) -> None:
        with self._lock:
            if len(self._clients) >= MOST_CLIENTS:
                client.close()
                return
            self._clients[client] = supervised_thread("gcs client", lambda: self._serve(client))
            self._clients[client].start()

    def _serve(self, client: socket.socket) -> None:
        with client:
            with suppress(OSError):  # a client that hangs up, or does not take its replies, is forgotten
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(_SEND_WITHIN_S))
                _converse(self._controller, lambda: client.recv(_RECEIVE_BYTES), client.sendall, self._baud)
            with self._lock:  # before the client learns that it was hung up on: its place is free by then
                self._clients.pop(client, None)


def _converse(
    controller: VirtualController, read: Callable[[], bytes], write: Callable[[bytes], object], baud: int | None
) -> None:
    """Answer one client until `read` returns nothing."""
    assembler, line = Assembler(), LineRate(baud)
    with _replies(write, LineRate(baud)) as send:
        while received := read():
            for piece in line.arriving(received):
                for command in assembler.feed(controller.carried(piece)):
                    if reply := controller.carried(controller.receive(command)):
                        send(reply, controller.reply_delay_s())


@contextmanager
def _replies(write: Callable[[bytes], object], line: LineRate) -> Iterator[Callable[[bytes, float], None]]:
    """Send replies in order; what takes time, from a thread of its own: a slow controller hears a stop all the same."""
    waiting: queue.Queue[tuple[float, bytes] | None] = queue.Queue()
    ended = threading.Event()

    def send(reply: bytes, delay_s: float) -> None:
        if delay_s > 0.0 or line.baud is not None or waiting.unfinished_tasks:
            waiting.put((time.monotonic() + delay_s, reply))
        else:
            write(reply)

    def send_late() -> None:
        while late := waiting.get():
            due_s, reply = late
            if not ended.wait(max(due_s - time.monotonic(), 0.0)):
                with suppress(OSError):  # the client may have gone before its answer came
                    for piece in line.arriving(reply):
                        write(piece)
            waiting.task_done()

    sending = supervised_thread("gcs late", send_late)
    sending.start()
    try:
        yield send
    finally:
        ended.set()
        waiting.put(None)
        sending.join(_END_WITHIN_S)


def _write_all(number: int, content: bytes) -> None:
    while content:
        content = content[os.write(number, content) :]


def _cause(error: OSError) -> str:
    return str(error) if error.errno is None else os.strerror(error.errno)


def _timeval(seconds: float) -> bytes:
    whole = int(seconds)
    return struct.pack("ll", whole, int((seconds - whole) * 1e6))
