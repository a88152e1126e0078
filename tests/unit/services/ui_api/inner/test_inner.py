"""Requests as the front writes them: read back as its parser had them, answered one after another on one connection."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import h11
import pytest
from fastapi import FastAPI, Request, Response
from hypothesis import example, given
from hypothesis import strategies as st

from services.ui_api.front.heads import forwarded
from services.ui_api.inner.bodies import BodyOfLength, BodyReader, ChunkedBody
from services.ui_api.inner.heads import HEAD_END, InnerHead
from services.ui_api.server import serving
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.front.rig import answer_of
from tests.unit.services.ui_api.served import unix_listening

TOKEN = st.text("abcdefghijklmnopqrstuvwxyzXYZ0123456789-_!#$%&'*+.^`|~", min_size=1, max_size=12)
# What h11 lets through, and what a second parser might take for an end: colons, spaces, letters that are no ASCII.
VALUE = st.binary(max_size=20).map(lambda raw: bytes(b for b in raw if b not in b"\r\n\0\x0b\x0c").strip(b" \t"))
TARGET = st.text(st.characters(min_codepoint=0x21, max_codepoint=0x7E), max_size=20).map(lambda text: f"/{text}")


def own(name: str) -> bool:
    """Whether the front does not say this itself, and h11 reads no framing off it."""
    return name.lower() not in ("connection", "content-length", "transfer-encoding", "host", "upgrade", "expect", "te")


@given(TARGET, st.lists(st.tuples(TOKEN.filter(own), VALUE), max_size=5))
@example("/robot", [("X-Forwarded-For", b"10.0.0.1"), ("x-forwarded-proto", b"http"), ("Forwarded", b"for=10.0.0.1")])
@example("/a:%20b?c=d: e".replace(" ", ""), [("a", b""), ("a", b": "), ("b", b"\xff")])
def test_a_head_is_read_back_as_the_fronts_parser_had_it(target: str, fields: list[tuple[str, bytes]]) -> None:
    raw = b"GET %s HTTP/1.1\r\nHost: g\r\n" % target.encode()
    raw += b"".join(b"%s: %s\r\n" % (name.encode(), value) for name, value in fields)
    parser = h11.Connection(h11.SERVER)
    parser.receive_data(raw + b"\r\n")
    try:
        request = parser.next_event()
    except h11.RemoteProtocolError:
        return  # the front refuses it
    assert isinstance(request, h11.Request)
    content = forwarded(request, "192.0.2.7", "https")
    assert content.find(HEAD_END) == len(content) - len(HEAD_END), "it must end in one place only"
    head = InnerHead.of(content)
    kept = [(n, v) for n, v in request.headers if n not in (b"keep-alive", b"proxy-connection", b"forwarded")]
    kept = [(n, v) for n, v in kept if n not in (b"x-forwarded-for", b"x-forwarded-proto")]
    assert head.target == request.target
    assert [field for field in head.fields if field[0] != b"connection"][:-2] == kept
    assert (head.client, head.scheme) == (("192.0.2.7", 0), "https")


@given(st.lists(st.binary(min_size=1, max_size=8), max_size=4), st.integers(1, 9))
def test_a_body_is_the_same_however_it_is_framed_and_cut(pieces: list[bytes], cut: int) -> None:
    body = b"".join(pieces)
    chunked = b"".join(b"%x\r\n%s\r\n" % (len(piece), piece) for piece in pieces) + b"0\r\n\r\n"
    readers: list[tuple[BodyReader, bytes]] = [(BodyOfLength(len(body)), body), (ChunkedBody(), chunked)]
    for reader, framed in readers:
        content, taken, sent = b"", b"", framed + b"GET"
        while sent and not reader.ended:
            content, sent = content + sent[:cut], sent[cut:]
            piece, content = reader.take(content)
            taken += piece
        assert (taken, reader.ended, content + sent) == (body, True, b"GET")


@pytest.mark.parametrize("content", [b"2\r\nabc\r\n", b"zz\r\nab\r\n", b"0" * 20])
def test_chunks_that_the_front_does_not_write_are_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match=r"chunk|literal"):
        ChunkedBody().take(content)


def small_application() -> FastAPI:
    app = FastAPI()

    @app.post("/echo")
    async def echo(request: Request) -> Response:
        body = await request.body()
        seen = {"body": body.decode(), "client": request.client and request.client.host, "url": str(request.url)}
        return Response(json.dumps(seen))

    @app.post("/deaf")
    async def deaf() -> Response:
        return Response("no")

    @app.get("/short")
    async def short() -> Response:
        return Response("abc", headers={"content-length": "5"})

    @app.get("/fault")
    async def fault() -> Response:
        raise ZeroDivisionError

    return app


@contextmanager
def connection() -> Iterator[socket.socket]:
    with ExitStack() as stack:
        address, listening = unix_listening(stack)
        stack.enter_context(serving(small_application(), listening, lambda: None))
        line = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        line.settimeout(PATIENCE_S)
        line.connect(str(address))
        yield line


def asked(path: str, framing: str = "x: y", method: str = "POST", more: str = "") -> bytes:
    head = f"{method} {path} HTTP/1.1\r\nhost: g:8000\r\n{framing}\r\n{more}"
    return f"{head}x-forwarded-for: 192.0.2.7\r\nx-forwarded-proto: https\r\n\r\n".encode()


def body_of(answer: bytes) -> bytes:
    return answer.partition(HEAD_END)[2]


def test_requests_are_answered_one_after_another_with_their_sender() -> None:
    with connection() as line:
        for framing, body in (("content-length: 3", b"abc"), ("transfer-encoding: chunked", b"3\r\nabc\r\n0\r\n\r\n")):
            head = asked("/echo", framing)
            for piece in (head[:9], head[9:] + body[:2], body[2:]):
                line.sendall(piece)
            answer = answer_of(line)
            assert answer.startswith(b"HTTP/1.1 200 OK\r\n")
            seen = json.loads(body_of(answer))
            assert seen == {"body": "abc", "client": "192.0.2.7", "url": "https://g:8000/echo"}


def test_a_body_that_nobody_reads_is_no_next_request() -> None:
    with connection() as line:
        line.sendall(asked("/deaf", "content-length: 60"))
        assert body_of(answer_of(line)) == b"no"
        line.sendall(asked("/echo", "content-length: 0")[:60])
        line.sendall(asked("/deaf"))
        assert body_of(answer_of(line)) == b"no"


def test_after_a_stream_its_client_asks_nothing_on_a_connection_that_was_handed_over() -> None:
    """The front would not have looked at it: at who sends it, whether it is a stop, how long it is."""
    with connection() as line:
        line.sendall(asked("/deaf", more="connection: close\r\n") + asked("/deaf"))
        answer = answer_of(line)
        assert b"\r\nconnection: close\r\n" in answer
        with_end = line.recv(1)
    assert with_end == b""


def test_an_answer_that_is_shorter_than_it_says_ends_its_connection() -> None:
    with connection() as line:
        line.sendall(asked("/short", method="GET"))
        content = b""
        while piece := line.recv(4096):
            content += piece
    assert body_of(content) == b"abc"


def test_a_fault_is_answered_and_the_next_request_too() -> None:
    with connection() as line:
        line.sendall(asked("/fault", method="GET"))
        assert answer_of(line).startswith(b"HTTP/1.1 500 ")
        line.sendall(asked("/deaf"))
        assert body_of(answer_of(line)) == b"no"


def test_what_the_front_never_writes_ends_the_connection() -> None:
    with connection() as line:
        line.sendall(b"nonsense\r\n\r\n")
        assert line.recv(1) == b""
