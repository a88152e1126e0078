"""A client of the virtual controller that sees every byte, and a clock that it is told."""

from collections.abc import Callable

import serial

from simulation.controller.virtual_controller import VirtualController

PATIENCE_S = 60.0
SILENCE_S = 0.2


class Clock:
    """Time that passes only when a test says so."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def pass_by(self, seconds: float) -> None:
        self.now_s += seconds


class Line:
    """A client's end of the wire."""

    def __init__(self, port: serial.SerialBase) -> None:
        self._port = port

    def send(self, text: str) -> None:
        self._port.write(text.encode("latin-1"))

    def read(self) -> str:
        """A whole reply: up to the first line end without a space before it."""
        reply = b""
        while not reply.endswith(b"\n") or reply.endswith(b" \n"):
            byte = self._port.read(1)
            assert byte, f"the reply stopped after {reply!r}"
            reply += byte
        return reply.decode("latin-1")

    def ask(self, question: str) -> str:
        self.send(question if len(question) == 1 else question + "\n")
        return self.read()

    def tell(self, command: str) -> int:
        """Send a command and return the error code it leaves."""
        self.send(command if len(command) == 1 else command + "\n")
        return int(self.ask("ERR?"))

    def silent(self) -> bool:
        self._port.timeout = SILENCE_S
        nothing = self._port.read(1) == b""
        self._port.timeout = PATIENCE_S
        return nothing


class Bench:
    """A virtual controller whose clock stands still, and a client on its line."""

    def __init__(self, controller: VirtualController, clock: Clock, connect: Callable[[], Line]) -> None:
        self.controller = controller
        self.clock = clock
        self.connect = connect
        self.line = connect()

    def unlock(self) -> None:
        for command in ("SVO X 1", "BRA X 0", "FRF"):
            assert self.line.tell(command) == 0
