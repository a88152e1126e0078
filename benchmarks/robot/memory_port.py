"""A line to the virtual controller within the process."""

import threading
from collections.abc import Callable

from simulation.controller.gcs_protocol import Assembler
from simulation.controller.virtual_controller import VirtualController

READ_WAIT_S = 0.005


class MemoryPort:
    """A line to the virtual controller within the process; the controller acts at once.

    Parameters
    ----------
    sent
        Where every `MOV` line is noted, before the line can spoil it.
    carry
        What the line does to bytes, going either way; what the virtual controller's faults do when not given.
    """

    def __init__(
        self, virtual: VirtualController, sent: list[str], carry: Callable[[bytes], bytes] | None = None
    ) -> None:
        self._carry = carry or virtual.carried
        self._virtual = virtual
        self._sent = sent
        self._assembler = Assembler()
        self._ready = threading.Condition()
        self._output = bytearray()
        self._late = bytearray()

    def read(self, size: int = 1, /) -> bytes:
        """As pyserial reads."""
        with self._ready:
            if not self._output:
                self._ready.wait(READ_WAIT_S)
            received = bytes(self._output[:size])
            del self._output[:size]
            return received

    def write(self, data: bytes, /) -> int:
        """As pyserial writes. Answers that are late come with the next thing that is written."""
        self._sent += [line for line in data.decode("ascii").splitlines() if line.startswith("MOV ")]
        with self._ready:
            self._output += self._late
            self._late.clear()
            for command in self._assembler.feed(self._carry(data)):
                reply = self._carry(self._virtual.receive(command))
                if self._virtual.reply_delay_s() > 0.0:
                    self._late += reply
                else:
                    self._output += reply
            self._ready.notify_all()
        return len(data)

    def close(self) -> None:
        """Nothing to do."""
