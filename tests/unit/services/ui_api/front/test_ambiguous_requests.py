"""Requests that two readers would understand differently, and bodies that trickle, over a socket."""

import asyncio
import socket

import pytest
from starlette.types import Message, Receive, Scope, Send

from services.ui_api.routes.body_limit import BodyLimitMiddleware
from tests.unit.services.ui_api.room import Room

POST = "POST /api/v1/cases HTTP/1.1\r\nHost: localhost\r\nIdempotency-Key: 1\r\nContent-Type: application/json\r\n"


def answer(room: Room, sent: str) -> str:
    """What comes back until the server closes, or has said nothing for long."""
    with socket.create_connection((room.client.base_url.host, room.client.base_url.port or 0)) as connection:
        connection.settimeout(10.0)
        connection.sendall(sent.encode())
        received = b""
        while chunk := connection.recv(65536):
            received += chunk
    return received.decode()


@pytest.mark.parametrize(
    ("name", "sent"),
    [
        ("length and chunks", POST + "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\nGET /x"),
        ("two lengths", POST + "Content-Length: 4\r\nContent-Length: 5\r\n\r\n{}  "),
        ("space before the colon", POST + "Content-Length : 2\r\n\r\n{}"),
        ("a length that is no number", POST + "Content-Length: +2\r\n\r\n{}"),
        ("an unknown coding", POST + "Transfer-Encoding: xchunked\r\n\r\n0\r\n\r\n"),
        ("two hosts", POST.replace("Host:", "Host: evil.example\r\nHost:") + "Content-Length: 2\r\n\r\n{}"),
        ("no host", POST.replace("Host: localhost\r\n", "") + "Content-Length: 2\r\n\r\n{}"),
        ("a control character", POST + "X: a\rb\r\nContent-Length: 2\r\n\r\n{}"),
    ],
)
def test_what_two_readers_would_understand_differently_is_refused(quiet_room: Room, name: str, sent: str) -> None:
    received = answer(quiet_room, sent)
    assert received.startswith(("HTTP/1.1 400", "HTTP/1.1 501")), (name, received)
    assert received.count("HTTP/1.1") == 1, (name, received)


async def reading(scope: Scope, receive: Receive, _send: Send) -> None:
    assert scope["type"] == "http"
    while (await receive()).get("more_body"):
        pass


def test_a_body_that_trickles_is_not_waited_for() -> None:
    async def trickling() -> Message:
        await asyncio.sleep(0.01)
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def unsent(_message: Message) -> None:
        raise AssertionError

    with pytest.raises(Exception, match=r"408: \d+ bytes of the body came within 0.1 s"):
        asyncio.run(BodyLimitMiddleware(reading, 0.1)({"type": "http"}, trickling, unsent))
