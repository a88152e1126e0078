"""Who a controller says that it is, asked on a line that nobody else uses; nothing is stopped or locked for it."""

import time
from typing import Final

from services.robot.devices.serial_port import Port

# Chosen: far above any identification; what exceeds it is garbage.
_LONGEST_ANSWER: Final = 200


def asked_identity(port: Port, question: bytes, within_s: float) -> str:
    """The line that answers a question, with what is no ASCII as escapes; empty when none came within `within_s`."""
    port.write(question)
    deadline_s, line = time.monotonic() + within_s, b""
    while not line.endswith(b"\n") and len(line) < _LONGEST_ANSWER and time.monotonic() < deadline_s:
        line += port.read(1)
    return line.decode("ascii", errors="backslashreplace").strip()
