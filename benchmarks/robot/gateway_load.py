"""Clients of a gateway, in a process of their own: `python -m benchmarks.robot.gateway_load --rest-port 8000 ...`.

Viewers of `WS /live`, event streams, connections that ask for nothing, and consoles that are stuck: they ask for both
and read nothing. Each comes again when it is closed. Says `ready` when all are there, runs until its standard input
ends, and prints what they received.
"""

import argparse
import asyncio
import json
import resource
import socket
import sys
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import websockets
from websockets.asyncio.client import connect

from distalock.rest_client import bearer

_HOST: Final = "127.0.0.1"
_AGAIN_AFTER_S: Final = 0.5
_PIECE_BYTES: Final = 256 * 1024
_EVENTS: Final = "GET /api/v1/events HTTP/1.1\r\nhost: 127.0.0.1\r\nauthorization: Bearer {}\r\n\r\n"
_LIVE: Final = (
    "GET /api/v1/live HTTP/1.1\r\nhost: 127.0.0.1\r\nauthorization: Bearer {}\r\nconnection: Upgrade\r\n"
    "upgrade: websocket\r\nsec-websocket-version: 13\r\nsec-websocket-key: c3R1Y2sgc3R1Y2sgc3R1Yw==\r\n\r\n"
)
# Of a pipe between machines, not of a buffer that would take minutes of pictures.
_STUCK_BUFFER_BYTES: Final = 64 * 1024
KINDS: Final = ("viewers", "events", "idle", "stuck")


@dataclass(slots=True)
class Load:
    """Everybody, and what they have received: pictures, events, and how often somebody had to come again."""

    port: int
    token: str
    received: Counter[str] = field(default_factory=Counter)
    connected: Counter[str] = field(default_factory=Counter)

    async def view(self) -> None:
        """Watch the live picture."""
        address, asks = f"ws://{_HOST}:{self.port}/api/v1/live", bearer(self.token)
        async with connect(address, max_size=None, compression=None, additional_headers=asks) as socket:
            self.connected["viewers"] += 1
            async for message in socket:
                self.received["pictures"] += isinstance(message, bytes)

    async def listen(self) -> None:
        """Read the event stream."""
        reader, writer = await asyncio.open_connection(_HOST, self.port)
        try:
            writer.write(_EVENTS.format(self.token).encode())
            self.connected["events"] += 1
            while content := await reader.read(_PIECE_BYTES):
                self.received["events"] += content.count(b"event: ")
        finally:
            writer.close()

    async def idle(self) -> None:
        """Hold a connection."""
        reader, writer = await asyncio.open_connection(_HOST, self.port)
        try:
            self.connected["idle"] += 1
            await reader.read(1)
        finally:
            writer.close()

    async def be_stuck(self) -> None:
        """Ask for pictures and events, and read neither, for ever."""
        loop = asyncio.get_running_loop()
        with socket.socket() as live, socket.socket() as events:
            for connection, request in ((live, _LIVE), (events, _EVENTS)):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _STUCK_BUFFER_BYTES)
                connection.setblocking(False)  # noqa: FBT003 - the standard library's signature
                await loop.sock_connect(connection, (_HOST, self.port))
                await loop.sock_sendall(connection, request.format(self.token).encode())
            self.connected["stuck"] += 1
            await asyncio.Event().wait()

    async def again_and_again(self, name: str) -> None:
        """Do one of these for ever."""
        act = {"viewers": self.view, "events": self.listen, "idle": self.idle, "stuck": self.be_stuck}[name]
        while True:
            with suppress(OSError, websockets.WebSocketException):
                await act()
            self.received[f"{name} closed"] += 1
            await asyncio.sleep(_AGAIN_AFTER_S)


async def run(port: int, token: str, wanted: dict[str, int]) -> Counter[str]:
    """Bring everybody, and wait for the end."""
    load = Load(port, token)
    tasks = [asyncio.create_task(load.again_and_again(name)) for name, count in wanted.items() for _ in range(count)]
    while any(load.connected[name] < count for name, count in wanted.items()):
        await asyncio.sleep(0.1)
    print("ready", flush=True)
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return load.received


def main() -> int:
    """Exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rest-port", type=int, required=True)
    parser.add_argument("--token", required=True)
    for name in KINDS:
        parser.add_argument(f"--{name}", type=int, default=0)
    given = parser.parse_args()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    wanted = {name: getattr(given, name) for name in KINDS}
    print(json.dumps(asyncio.run(run(given.rest_port, given.token, wanted))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
