"""Heads of HTTP/1.1 messages on their way through the front: pure functions of what h11 has parsed, and of bytes."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final
from urllib.parse import unquote, urlsplit

import h11

STOP_PATH: Final = "/api/v1/robot/stop"
# They hold for one connection only, or are this process's own to say.
_OF_ONE_CONNECTION: Final = frozenset((b"connection", b"keep-alive", b"proxy-connection", b"te", b"expect"))
_OF_THE_FRONT: Final = frozenset((b"x-forwarded-for", b"x-forwarded-proto", b"forwarded"))
_FRAMING: Final = frozenset((b"content-length", b"transfer-encoding"))
_EVENTS: Final = "/events"
_END: Final = b"\r\n\r\n"
_CHUNKED_END: Final = b"0\r\n\r\n"
_NO_BODY: Final = frozenset((204, 304))
_READING: Final = frozenset((b"GET", b"HEAD"))
# What of an answer's head the front reads: one line each, with the line's end before it.
_OF_ANSWER: Final = re.compile(
    rb"\r\n(content-length|transfer-encoding|connection)[ \t]*:[ \t]*([^\r\n]*?)[ \t]*(?=\r\n)", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class Sender:
    """Who sends: its address, and the scheme by which it has come."""

    address: str
    scheme: str


class RequestHead:
    """A request's head and what the front reads off it, each found out once: heads are met again (`incoming`)."""

    def __init__(self, request: h11.Request, sender: Sender) -> None:
        self.request, self._sender = request, sender

    @cached_property
    def is_stop(self) -> bool:
        """See `is_stop`."""
        return is_stop(self.request)

    @cached_property
    def is_upgrade(self) -> bool:
        """See `is_upgrade`."""
        return is_upgrade(self.request)

    @cached_property
    def is_stream(self) -> bool:
        """See `is_stream`."""
        return is_stream(self.request)

    @cached_property
    def is_repeatable(self) -> bool:
        """See `is_repeatable`."""
        return is_repeatable(self.request)

    @cached_property
    def stays_open(self) -> bool:
        """See `stays_open`."""
        return stays_open(self.request)

    @cached_property
    def states_length(self) -> bool:
        """Whether it says that a body follows, however short."""
        return any(name in _FRAMING for name, _ in self.request.headers)

    @cached_property
    def is_chunked(self) -> bool:
        """See `is_chunked`."""
        return is_chunked(self.request)

    @cached_property
    def forwarded(self) -> bytes:
        """See `forwarded`."""
        return forwarded(self.request, self._sender.address, self._sender.scheme)

    @property
    def path(self) -> str:
        """See `path_of`."""
        return path_of(self.request)


def is_stop(request: h11.Request) -> bool:
    """Whether a request is one for a stop, however its path is spelled."""
    return request.method == b"POST" and path_of(request) == STOP_PATH


def path_of(request: h11.Request) -> str:
    """The path without its query, as plain text."""
    try:
        return unquote(urlsplit(request.target.decode("ascii", "replace")).path)
    except ValueError:  # brackets that are no address
        return request.target.decode("ascii", "replace")


def is_upgrade(request: h11.Request) -> bool:
    """Whether the client wants to go on with another protocol: with a WebSocket."""
    return any(name == b"upgrade" for name, _ in request.headers)


def is_stream(request: h11.Request) -> bool:
    """Whether the answer goes on and on: a WebSocket, or an event stream."""
    return is_upgrade(request) or (request.method == b"GET" and path_of(request).endswith(_EVENTS))


def is_repeatable(request: h11.Request) -> bool:
    """Whether a request may be sent again where a kept connection turns out to be closed: it only reads."""
    return request.method in _READING and not any(name in _FRAMING for name, _ in request.headers)


def stays_open(request: h11.Request) -> bool:
    """Whether the connection is kept for more requests.

    Not when the client says otherwise, and not when the request states its length twice: somebody else on the way may
    have taken the rest for its body, and what comes next would be a request that nobody sent.
    """
    wanted = request.http_version == b"1.1" and b"close" not in _connection_tokens(request)
    return wanted and not states_length_twice(request)


def states_length_twice(request: h11.Request) -> bool:
    """Whether two readers may disagree where a request ends; its application refuses it (`request_policy`)."""
    return sum(name in _FRAMING for name, _ in request.headers) > 1


def is_chunked(request: h11.Request) -> bool:
    """Whether a body follows in chunks."""
    return any(name == b"transfer-encoding" for name, _ in request.headers)


def forwarded(request: h11.Request, peer: str, scheme: str) -> bytes:
    """The head as the application gets it: who has sent it; its connection takes more requests unless this streams."""
    lines = [b"%s %s HTTP/%s" % (request.method, request.target, request.http_version)]
    lines += [b"%s: %s" % field for field in _kept(request)]
    if is_stream(request):
        lines.append(b"connection: upgrade" if is_upgrade(request) else b"connection: close")
    lines.append(b"x-forwarded-for: " + peer.encode("ascii", "replace"))
    lines.append(b"x-forwarded-proto: " + scheme.encode("ascii"))
    return b"\r\n".join(lines) + _END


def _connection_tokens(request: h11.Request) -> set[bytes]:
    fields = (value for name, value in request.headers if name == b"connection")
    return {token.strip().lower() for value in fields for token in value.split(b",")}


def _kept(request: h11.Request) -> Iterator[tuple[bytes, bytes]]:
    named = _connection_tokens(request)
    dropped = (_OF_ONE_CONNECTION | _OF_THE_FRONT | named) - {b"upgrade"}
    return ((name, value) for name, value in request.headers if name not in dropped)


@dataclass(slots=True)
class AnswerFraming:
    """Tells whether an answer has come whole, from its head and the bytes after it.

    Attributes
    ----------
    length_bytes
        Of the body, when the head says it.
    keeps_open
        Whether the application's connection takes another request afterwards.
    """

    chunked: bool
    length_bytes: int | None
    keeps_open: bool = True
    received_bytes: int = 0
    tail: bytes = b""

    @staticmethod
    def of(head: bytes, method: bytes) -> "AnswerFraming":
        """Read an answer's head, to a request with this method."""
        named = {name.lower(): value for name, value in _OF_ANSWER.findall(head)}
        keeps_open = named.get(b"connection", b"").lower() != b"close"
        if method == b"HEAD" or int(head.split(b" ", 2)[1]) in _NO_BODY:
            return AnswerFraming(chunked=False, length_bytes=0, keeps_open=keeps_open)
        length = named.get(b"content-length")
        chunked = named.get(b"transfer-encoding", b"").lower() == b"chunked"
        return AnswerFraming(chunked, None if length is None else int(length), keeps_open)

    def take(self, content: bytes) -> None:
        """Note what has come of the body."""
        self.received_bytes += len(content)
        self.tail = (self.tail + content[-len(_CHUNKED_END) :])[-len(_CHUNKED_END) :]

    @property
    def ended(self) -> bool:
        """Whether nothing more can come; that an answer in chunks has ended, its connection says."""
        return not self.chunked and self.received_bytes == self.length_bytes

    @property
    def whole(self) -> bool:
        """Whether the end has come; never true of an answer that only the connection's end ends."""
        return self.ended or (self.chunked and self.tail == _CHUNKED_END)


def answer_head(head: bytes, *, keeps_open: bool) -> bytes:
    """The application's answer's head as the client gets it: whether its own connection stays open."""
    kept = _OF_ANSWER.sub(lambda line: b"" if line[1].lower() == b"connection" else line[0], head)
    return kept if keeps_open else kept[: -len(_END)] + b"\r\nconnection: close" + _END
