"""A request's body as the front writes it: of a length that its head states, or in chunks without extensions."""

from typing import Final, Protocol

_LINE_END: Final = b"\r\n"
# Of a chunk's length in hexadecimal digits; a piece of the front has at most five.
_LONGEST_LENGTH: Final = 16


class BodyReader(Protocol):
    """Takes a body off what has come."""

    @property
    def ended(self) -> bool:
        """Whether it has come whole."""

    def take(self, content: bytes) -> tuple[bytes, bytes]:
        """What of it is body, and what is left: of the next request when the body has ended, else to come again."""


class BodyOfLength:
    """So many bytes."""

    def __init__(self, length_bytes: int) -> None:
        self._missing_bytes = length_bytes

    @property
    def ended(self) -> bool:
        """Whether it has come whole."""
        return self._missing_bytes == 0

    def take(self, content: bytes) -> tuple[bytes, bytes]:
        """Those that belong to it, and the rest."""
        body = content[: self._missing_bytes]
        self._missing_bytes -= len(body)
        return body, content[len(body) :]


class ChunkedBody:
    """Chunks up to the empty one."""

    def __init__(self) -> None:
        self.ended = False

    def take(self, content: bytes) -> tuple[bytes, bytes]:
        """Whole chunks, and the rest; raises `ValueError` when the front did not write it."""
        pieces = list[bytes]()
        while not self.ended:
            digits, found, rest = content.partition(_LINE_END)
            if not found:
                if len(content) > _LONGEST_LENGTH:
                    raise ValueError("a chunk without its length")
                break
            length_bytes = int(digits, 16)
            if len(rest) < length_bytes + len(_LINE_END):
                break
            piece, end = rest[:length_bytes], rest[length_bytes : length_bytes + len(_LINE_END)]
            if end != _LINE_END:
                raise ValueError("a chunk that is longer than its length")
            pieces.append(piece)
            content, self.ended = rest[length_bytes + len(_LINE_END) :], length_bytes == 0
        return b"".join(pieces), content
