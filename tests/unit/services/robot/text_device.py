"""A port with a device at its end that is told text and answers with text: for the tests of a small dialect."""

import queue
from abc import ABC, abstractmethod

READ_WAIT_S = 0.01


class TextDevice(ABC):
    """What pyserial would be; a test writes `obey`."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.closed = False
        self._answers: queue.Queue[int] = queue.Queue()

    @abstractmethod
    def obey(self, message: bytes) -> bytes:
        """Do what was written in one go; the answer, or nothing."""

    def write(self, data: bytes, /) -> int:
        """What pyserial's `write` does; the device acts at once."""
        self.messages.append(data)
        for byte in self.obey(data):
            self._answers.put(byte)
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        """What pyserial's `read` does, with a short time-out."""
        assert size == 1
        try:
            return bytes([self._answers.get(timeout=READ_WAIT_S)])
        except queue.Empty:
            return b""

    def close(self) -> None:
        """End."""
        self.closed = True
