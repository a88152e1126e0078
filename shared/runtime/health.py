"""A container's health check: `python -I -S shared/runtime/health.py PLACE`; 0 when what is there is well.

The place is the file in which a service notes its heartbeats, or an address of a server (``tcp://host:port``,
``unix:///path``). It is started again and again beside what computes, so it imports little, and ends by itself: docker
gives a check up that takes too long, but lets it run, and on a busy machine checks would hold up each other.
"""

import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

# Chosen: ten heartbeats of the service that sends the fewest, as the gateway has it too.
SILENT_AFTER_S: Final = 2.0
_ANSWER_WITHIN_S: Final = 3.0
# Before docker gives it up.
_ENDS_WITHIN_S: Final = 4


class HealthFile:
    """Where a service notes each heartbeat with its condition, for a health check in its container.

    Lies in memory (a tmpfs): what the disk does must not hold up a heartbeat.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._noted = ""

    def note(self, condition: str) -> None:
        """Note a heartbeat. A file that cannot be written makes the service look ill, and nothing else."""
        with suppress(OSError):
            if condition == self._noted:
                os.utime(self._file)
            else:
                self._file.write_text(condition, encoding="ascii")
                self._noted = condition


def why_unwell(place: str) -> str:
    """What is wrong with what is there; empty when it is well."""
    try:
        scheme, address = urlsplit(place).scheme, urlsplit(place)
        if scheme == "tcp":
            socket.create_connection((address.hostname, address.port), _ANSWER_WITHIN_S).close()
        elif scheme == "unix":
            _connect(address.path)
        else:
            return _why_silent(Path(place))
    except OSError as error:
        return f"{place}: {error}"
    return ""


def _connect(path: str) -> None:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(_ANSWER_WITHIN_S)
        connection.connect(path)


def _why_silent(file: Path) -> str:
    silent_s = time.time() - file.stat().st_mtime
    if silent_s > SILENT_AFTER_S:
        return f"the last heartbeat was {silent_s:.1f} s ago (limit {SILENT_AFTER_S:g} s)"
    condition = file.read_text(encoding="ascii")
    return f"the service is {condition}" if condition not in ("ready", "degraded") else ""


if __name__ == "__main__":
    signal.alarm(_ENDS_WITHIN_S)
    unwell = why_unwell(sys.argv[1])
    print(unwell or "well")  # noqa: T201 - what `docker inspect` shows
    sys.exit(1 if unwell else 0)
