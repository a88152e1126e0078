"""A router process with certificates and access control, and sessions of every service at it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from shared.bus.tls import TlsFiles
from shared.bus.zenoh_bus import BusSettings, ZenohBus, open_bus
from shared.pki.keystore import ROUTER, Keystore
from tests.contract.bus.rooms import PATIENCE_S, free_port

ROOM = "test"


@dataclass(frozen=True, slots=True)
class SecureRoom:
    """A running router, and the keys of those it lets in."""

    endpoint: str
    keystore: Keystore

    def files_of(self, name: str) -> TlsFiles:
        return TlsFiles.in_folder(self.keystore.folder_of(name))

    def open_as(self, name: str) -> ZenohBus:
        return open_bus(BusSettings(self.endpoint, PATIENCE_S, self.files_of(name)))


@contextmanager
def secure_room(folder: Path) -> Iterator[SecureRoom]:
    """Keys in a new folder, and a router that answers."""
    keystore = Keystore(folder)
    keystore.ensure(datetime.now(UTC))
    room = SecureRoom(f"tls/127.0.0.1:{free_port()}", keystore)
    with running_router_of(room):
        yield room


@contextmanager
def running_router_of(room: SecureRoom) -> Iterator[None]:
    """The room's router as a process, which is killed in the end."""
    files = room.files_of(ROUTER)
    command = [
        *(sys.executable, "-m", "shared.bus.router", "--room", ROOM, "--listen", room.endpoint),
        *("--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key)),
    ]
    with subprocess.Popen(command) as process:
        try:
            with room.open_as("robot"):
                pass
            yield
        finally:
            process.kill()
