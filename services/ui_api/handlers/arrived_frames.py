"""Headers of frames that have come and are not on record yet, so that those that had to wait are recorded together.

Behind a slow disk frames come faster than they go one by one: the inbox would fill, and an X-ray wait behind them.
"""

from collections import deque

from shared.messages.base import MessageInvalid, decode
from shared.messages.imaging import FrameHeader
from shared.runtime.logging import Log


class ArrivedFrames:
    """For one thread that puts and one that records. It keeps headers and no pixels, which would be gigabytes."""

    def __init__(self, size: int, log: Log) -> None:
        self._size, self._log = size, log
        self._attachments: deque[bytes] = deque()

    def put(self, attachment: bytes) -> None:
        """Keep a frame's header; one too many is left out, and asked for again by its number."""
        if len(self._attachments) < self._size:
            self._attachments.append(attachment)

    def waiting(self) -> tuple[int, list[FrameHeader]]:
        """How many wait, and the headers of different images among them: one that is none is reported."""
        count = len(self._attachments)
        headers: dict[tuple[str, str | None], FrameHeader] = {}
        for place in range(count):
            try:
                header = decode(FrameHeader, self._attachments[place])
            except MessageInvalid as error:
                self._log.error("message_invalid", detail=str(error))
            else:
                headers.setdefault((header.sha256, header.case_id), header)
        return count, list(headers.values())

    def recorded(self, count: int) -> None:
        """Let go of the oldest, which are on record."""
        for _ in range(count):
            self._attachments.popleft()
