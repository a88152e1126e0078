"""A request's head as the front writes it (`front.heads.forwarded`): split where the front has joined, and no more.

The front's parser decides what a request is; a second one could only be of another opinion.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final
from urllib.parse import unquote

HEAD_END: Final = b"\r\n\r\n"
_SENDER: Final = b"x-forwarded-for"
_SCHEME: Final = b"x-forwarded-proto"
Fields = tuple[tuple[bytes, bytes], ...]


@dataclass(frozen=True)
class InnerHead:
    """What the front says of a request.

    Attributes
    ----------
    content
        As it came.
    fields
        Names in small letters, and values.
    """

    content: bytes
    method: str
    target: bytes
    http_version: str
    fields: Fields

    @staticmethod
    def of(content: bytes) -> "InnerHead":
        """Split a head; raises `ValueError` when the front did not write it."""
        first, *lines = content.removesuffix(HEAD_END).split(b"\r\n")
        method, target, version = first.split(b" ")
        fields = tuple((name, value) for name, _, value in (line.partition(b": ") for line in lines))
        return InnerHead(
            content, method.decode("ascii"), target, version.removeprefix(b"HTTP/").decode("ascii"), fields
        )

    @cached_property
    def length_bytes(self) -> int | None:
        """Of the body; None when it comes in chunks."""
        named = dict(self.fields)
        return None if b"transfer-encoding" in named else int(named.get(b"content-length", b"0"))

    @cached_property
    def is_last(self) -> bool:
        """Whether nothing may follow on its connection: it streams, and who asks may be the client himself.

        The front has then handed over his connection, and what he sends next it would not have looked at.
        """
        return any(name == b"connection" for name, _ in self.fields)

    @cached_property
    def is_websocket(self) -> bool:
        """Whether that protocol is WebSocket."""
        return any(name == b"upgrade" and value.lower() == b"websocket" for name, value in self.fields)

    @cached_property
    def client(self) -> tuple[str, int]:
        """Address of who has sent it, as the front saw it; a port is of no use here."""
        return dict(self.fields).get(_SENDER, b"unknown").decode("ascii", "replace"), 0

    @cached_property
    def scheme(self) -> str:
        """By which it came to the front."""
        return dict(self.fields).get(_SCHEME, b"http").decode("ascii", "replace")

    @cached_property
    def path(self) -> str:
        """Without its query, as plain text."""
        return unquote(self._raw_path.decode("ascii", "replace"))

    @property
    def _raw_path(self) -> bytes:
        return self.target.partition(b"?")[0]

    def scope(self, extensions: dict[str, Any]) -> dict[str, Any]:
        """The request as ASGI has it."""
        return {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": self.http_version,
            "server": None,
            "client": self.client,
            "scheme": self.scheme,
            "method": self.method,
            "root_path": "",
            "path": self.path,
            "raw_path": self._raw_path,
            "query_string": self.target.partition(b"?")[2],
            "headers": list(self.fields),
            "extensions": extensions,
            "state": {},
        }
