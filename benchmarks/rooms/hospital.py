"""Rooms, each with router, exporter and light services, and the site that they show themselves to: processes."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from benchmarks.rooms.relay import Network, network_to
from distalock.local_ports import free_ports, tcp_port_answers
from distalock.site.command import router_arguments
from shared.bus.access import EXPORTER
from shared.bus.port import Sample
from shared.bus.settings import BusSettings
from shared.bus.site import ANY_SUMMARY, DESK
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.bus.zenoh_bus import open_bus
from shared.messages.base import MessageInvalid, decode
from shared.messages.site import RoomSummary
from shared.pki.keystore import ROUTER, Keystore
from shared.pki.site import site_keystore
from shared.signals import PARENT_PIPE

_START_WITHIN_S: Final = 60.0
_S_TO_NS: Final = 1e9
_KIB: Final = 1024
Latencies = dict[str, list[float]]


@dataclass(slots=True)
class Room:
    """One room's processes: router, light services, exporter."""

    name: str
    endpoint: str
    state: Path
    network: Network
    processes: "list[subprocess.Popen[str]]" = field(default_factory=list)

    @property
    def services(self) -> "subprocess.Popen[str]":
        """The light services, which take orders."""
        return self.processes[1]

    def ask(self, order: str) -> str:
        """Give the light services an order, and wait for their answer."""
        assert self.services.stdin is not None
        assert self.services.stdout is not None
        self.services.stdin.write(f"{order}\n")
        self.services.stdin.flush()
        return self.services.stdout.readline()

    def measure(self, seconds: float) -> Latencies:
        """Latencies of stops, commands and states, in seconds."""
        found: Latencies = json.loads(self.ask(f"measure {seconds}"))
        return found

    def resident_mib(self) -> tuple[float, float]:
        """Memory of its router and of its exporter."""
        return resident_mib(self.processes[0].pid), resident_mib(self.processes[2].pid)


class Desk:
    """What a control desk sees: when each room's summary came last, and how late a change was seen."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen_at_s: dict[str, float] = {}
        self._last: dict[str, str] = {}
        self.late_s: list[float] = []

    def on_sample(self, sample: Sample) -> None:
        """A summary, or what a flood says."""
        try:
            summary = decode(RoomSummary, sample.payload)
        except MessageInvalid:
            return
        detail = "" if summary.robot is None else summary.robot.detail
        with self._lock:
            self._seen_at_s[summary.room] = time.monotonic()
            if detail and self._last.get(summary.room) not in (None, detail):
                self.late_s.append((time.monotonic_ns() - int(detail)) / _S_TO_NS)
            self._last[summary.room] = detail

    def age_s(self, room: str) -> float:
        """How long ago a room was seen; infinite when it never was."""
        with self._lock:
            return time.monotonic() - self._seen_at_s.get(room, float("-inf"))


class Hospital:
    """A site with its router and desk; rooms are added one by one. Use within an `ExitStack`."""

    def __init__(self, folder: Path, names: Sequence[str], stack: ExitStack, *, own_cores: bool) -> None:
        self._folder, self._stack = folder, stack
        self._cores = _cores_of_their_own(stack) if own_cores else None
        self.rooms: list[Room] = []
        # Its other end closes with this process, however that ends.
        self._lifeline, kept_open = os.pipe()
        stack.callback(os.close, self._lifeline)
        stack.callback(os.close, kept_open)
        self.site_state = folder / "site"
        self.site_keys = site_keystore(self.site_state / PKI_FOLDER, names)
        self.site_keys.ensure(datetime.now(UTC))
        (self.port,) = free_ports(1)
        self.endpoint = f"tls/127.0.0.1:{self.port}"
        self.router = self._process("shared.bus.router", *router_arguments(self.site_state, self.endpoint))
        _wait_for(self.port)
        self.desk = Desk()
        keys = TlsFiles.in_folder(self.site_keys.folder_of(DESK))
        bus = stack.enter_context(open_bus(BusSettings(self.endpoint, _START_WITHIN_S, keys)))
        bus.subscribe_retained(ANY_SUMMARY, self.desk.on_sample)

    def add_room(self, name: str) -> Room:
        """Start a room; it is ready afterwards, and the desk sees it."""
        state = self._folder / name
        keystore = Keystore(state / PKI_FOLDER)
        keystore.ensure(datetime.now(UTC))
        (port,) = free_ports(1)
        network, near_port = self._stack.enter_context(network_to(self.port))
        room = Room(name, f"tls/127.0.0.1:{port}", state, network)
        first = not self.rooms
        router = ("shared.bus.router", "--room", name, "--listen", room.endpoint, *_files(keystore, ROUTER))
        room.processes.append(self._process(*router, alone=first))
        _wait_for(port)
        room.processes.append(
            self._process("benchmarks.rooms.light_room", name, room.endpoint, str(state), alone=first)
        )
        assert room.services.stdout is not None
        assert room.services.stdout.readline().strip() == "ready"
        shown = ("--site", f"tls/127.0.0.1:{near_port}", "--site-keys", str(self.site_keys.folder_of(name)))
        own = ("--room", name, "--router", room.endpoint, *_files(keystore, EXPORTER))
        room.processes.append(self._process("shared.bus.exporter", *own, *shown, alone=first))
        self.rooms.append(room)
        self.wait_until_seen(name)
        return room

    def wait_until_seen(self, name: str) -> float:
        """Seconds until the desk sees a room again."""
        began_s = time.monotonic()
        while self.desk.age_s(name) > time.monotonic() - began_s:
            if time.monotonic() - began_s > _START_WITHIN_S:
                raise TimeoutError(f"the desk does not see {name}")
            time.sleep(0.02)
        return time.monotonic() - began_s

    def flood_site(self, name: str) -> "subprocess.Popen[str]":
        """Whoever has a room's key for the site says all that it can there."""
        return self._process("benchmarks.rooms.site_flood", name, self.endpoint, str(self.site_keys.folder_of(name)))

    def _process(self, module: str, *words: str, alone: bool = False) -> "subprocess.Popen[str]":
        """A process; those of the measured room have a processor of their own, as they would have a machine."""
        process = subprocess.Popen(
            [sys.executable, "-m", module, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
            pass_fds=(self._lifeline,),
            env={**os.environ, PARENT_PIPE: str(self._lifeline)},
        )
        if self._cores is not None:
            os.sched_setaffinity(process.pid, {self._cores[0] if alone else self._cores[-1]})
        self._stack.callback(_ended, process)
        return process


def _cores_of_their_own(stack: ExitStack) -> list[int]:
    """The measured room's processor, and last that of everybody else, on which this process stays: it is the desk."""
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, cores[-1:])
    stack.callback(os.sched_setaffinity, 0, cores)
    return cores


def resident_mib(pid: int) -> float:
    """Resident memory of a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / _KIB for line in lines if line.startswith("VmRSS"))


def processor_s(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _files(keystore: Keystore, name: str) -> tuple[str, ...]:
    files = TlsFiles.in_folder(keystore.folder_of(name))
    return ("--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key))


def _wait_for(port: int) -> None:
    deadline_s = time.monotonic() + _START_WITHIN_S
    while not tcp_port_answers(port):
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"nothing listens at port {port} after {_START_WITHIN_S:g} s")
        time.sleep(0.05)


def _ended(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.wait()
