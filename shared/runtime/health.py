"""A container's health check: `python -m shared.runtime.health PLACE [AUTHORITY]`; 0 when what is there is well.

The place is the file in which a service notes its heartbeats, an address of a server (``tcp://host:port``,
``unix:///path``), or an address that answers 200 (``https://.../readyz``) with a certificate of the authority in the
file that is named. Imports the standard library alone, for it is started every few seconds.
"""

import http.client
import os
import socket
import ssl
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

# Chosen: ten heartbeats of the service that sends the fewest, as the gateway has it too.
SILENT_AFTER_S: Final = 2.0
_ANSWER_WITHIN_S: Final = 3.0
_OK: Final = 200


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


def why_unwell(place: str, authority: str | None = None) -> str:
    """What is wrong with what is there; empty when it is well."""
    try:
        scheme, address = urlsplit(place).scheme, urlsplit(place)
        if scheme == "tcp":
            socket.create_connection((address.hostname, address.port), _ANSWER_WITHIN_S).close()
        elif scheme == "unix":
            _connect(address.path)
        elif scheme in ("http", "https"):
            return _why_not_ready(place, authority)
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


def _why_not_ready(url: str, authority: str | None) -> str:
    address = urlsplit(url)
    host = address.hostname or ""
    connection = http.client.HTTPConnection(host, address.port, timeout=_ANSWER_WITHIN_S)
    if address.scheme == "https":
        context = ssl.create_default_context(cafile=authority)
        connection = http.client.HTTPSConnection(host, address.port, timeout=_ANSWER_WITHIN_S, context=context)
    try:
        connection.request("GET", address.path)
        answer = connection.getresponse()
        content = answer.read().decode(errors="replace")
    except http.client.HTTPException as error:
        return f"{url}: {type(error).__name__}"
    finally:
        connection.close()
    return "" if answer.status == _OK else content


if __name__ == "__main__":
    unwell = why_unwell(*sys.argv[1:3])
    print(unwell or "well")  # noqa: T201 - what `docker inspect` shows
    sys.exit(1 if unwell else 0)
