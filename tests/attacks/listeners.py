"""What listens, and where: every socket of the installation's processes, from `/proc`, beside what is announced."""

import ipaddress
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.attacks.attack import Attack
from tests.attacks.site import Site

_LISTENING: Final = "0A"
_UNCONNECTED: Final = "07"
_SOCKET: Final = re.compile(r"socket:\[(\d+)\]")


def listening_sockets(pids: set[int]) -> set[tuple[str, str, int]]:
    """Protocol, address and port of all that processes and their children listen on."""
    inodes = {inode for pid in _with_children(pids) for inode in _inodes(pid)}
    found = set()
    for table, state in (("tcp", _LISTENING), ("tcp6", _LISTENING), ("udp", _UNCONNECTED), ("udp6", _UNCONNECTED)):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, local, _, seen, *_, inode = line.split()[:10]
            if seen == state and inode in inodes:
                address, port = local.split(":")
                found.add((table, _address(address), int(port, 16)))
    return found


def _with_children(pids: set[int]) -> set[int]:
    known = set(pids)
    parents = dict(_processes())
    while grown := {pid for pid, parent in parents.items() if parent in known} - known:
        known |= grown
    return known


def _processes() -> Iterator[tuple[int, int]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended
            yield int(entry.name), int(fields[1])


def _inodes(pid: int) -> Iterator[str]:
    try:
        handles = list(Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return
    for handle in handles:
        try:
            target = _SOCKET.match(str(handle.readlink()))
        except OSError:
            continue
        if target is not None:
            yield target[1]


def _address(words: str) -> str:
    """Words of four bytes in the machine's order, as `/proc` writes an address."""
    raw = b"".join(bytes.fromhex(words[at : at + 8])[::-1] for at in range(0, len(words), 8))
    return str(ipaddress.ip_address(raw))


def _only_what_is_announced(site: Site) -> str:
    ports = site.installation.ports
    announced = {
        ("tcp", "127.0.0.1", port) for port in (ports.router, ports.rest, ports.dicom, ports.gcs, ports.control)
    }
    found = listening_sockets(set(site.fleet.pids.values()))
    if missing := announced - found:
        return f"not found: {sorted(missing)}"
    return f"not announced: {sorted(found - announced)}" if found - announced else "only what is announced"


ATTACKS: Final = (
    Attack(
        "another way in",
        "the hospital's network",
        "look for a listener of any process on another address or port than those announced",
        "only what is announced",
        None,
        _only_what_is_announced,
    ),
)
