"""Whoever has a room's key for the site says all that it can there: `site_flood ROOM ENDPOINT KEYS`, until killed."""

import sys
from pathlib import Path
from typing import Final

from shared.bus.settings import BusSettings
from shared.bus.site import summary_key
from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import open_bus

_BYTES: Final = 500_000


def run() -> int:
    """Publish without a pause, under its own name, for another name is denied."""
    with open_bus(BusSettings(sys.argv[2], 60.0, TlsFiles.in_folder(Path(sys.argv[3])))) as bus:
        publisher, content = bus.publisher(summary_key(sys.argv[1])), bytes(_BYTES)
        while True:
            publisher.put(content)


if __name__ == "__main__":
    sys.exit(run())
