"""Where images are sent."""

import re
from dataclasses import dataclass

_TARGET = re.compile(r"(?:(?P<title>[^@]{1,16})@)?(?P<host>[^@:\s]+):(?P<port>\d{1,5})")


@dataclass(frozen=True, slots=True)
class DicomTarget:
    """Where images go."""

    host: str
    port: int
    title: str = "DISTALOCK"

    def __str__(self) -> str:
        return f"{self.title}@{self.host}:{self.port}"


def parse_target(text: str) -> DicomTarget:
    """Read ``[TITLE@]HOST:PORT``; raises `ValueError`."""
    found = _TARGET.fullmatch(text)
    if found is None or not 0 < int(found["port"]) <= 65535:
        raise ValueError(f"'{text}' is no DICOM target; write [TITLE@]HOST:PORT, for example 127.0.0.1:11112")
    if found["title"] is None:
        return DicomTarget(found["host"], int(found["port"]))
    return DicomTarget(found["host"], int(found["port"]), found["title"])
