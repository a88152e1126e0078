"""Frames and commands on the bus beside bare Zenoh in the same run; writes docs/benchmarks/bus.md.

Three routers stand side by side: bare Zenoh with its defaults, the project's bus without TLS, and the bus as it is
delivered, under mutual TLS and access control. Rounds go from one to the next, so that whatever else the machine does
meets all three. A figure is the median over the rounds of the ratio of medians.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.bus.ends import KINDS, Kind, NearEnd, near_end
from benchmarks.common.places import PAGES
from distalock.local_ports import free_ports, tcp_port_answers
from shared.arguments import OneLineParser
from shared.bus.shared_memory import MemoryLimits, shared_memory_shortage
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.pki.keystore import ROUTER, Keystore

REPORT = PAGES / "bus.md"
FRAME_BYTES: Final = 2_000_000
FRAME_HZ: Final = 30.0
FRAMES_A_ROUND: Final = 45
COMMANDS_A_ROUND: Final = 200
COMMAND_BYTES: Final = 500
ROUNDS: Final = 10
FRAME_LIMIT: Final = 1.3
COMMAND_LIMIT: Final = 1.5
# The first frames find pools that are not mapped yet, in all three.
WARM_UP_FRAMES: Final = 15
_SETTLE_S: Final = 0.3
_START_WITHIN_S: Final = 30.0
_NAMES: Final[dict[Kind, str]] = {
    "bare": "bare Zenoh, its defaults, TCP",
    "plain": "the bus without TLS",
    "protected": "the bus: mutual TLS, access control",
}
_HEAD: Final = """# The bus beside bare Zenoh

Made by `distalock bench bus`: {} rounds of {} frames of 2 MB at {:.0f}/s and {} commands of {} bytes with their
answers, from one process through a router process to a third, on one machine. All three stand side by side, and each
round goes through all of them. A ratio is the median over the rounds of the ratio of medians.

| | frame: median | 99 % | arrived | ratio | command: median | 99 % | ratio |
|---|---|---|---|---|---|---|---|
"""


@dataclass(slots=True)
class Bus:
    """One of the three, with what was measured on it: a list of seconds a round."""

    kind: Kind
    near: NearEnd
    far: "subprocess.Popen[str]"
    frames_s: list[list[float]] = field(default_factory=list)
    commands_s: list[list[float]] = field(default_factory=list)

    def round(self) -> None:
        """Send frames, then ask."""
        self.frames_s.append(self.frames(FRAMES_A_ROUND))
        self.commands_s.append([self.command_s() for _ in range(COMMANDS_A_ROUND)])

    def frames(self, count: int) -> list[float]:
        """Send frames at their rate; how long each that arrived took."""
        frame, due_s = os.urandom(FRAME_BYTES), time.monotonic()
        for _ in range(count):
            time.sleep(max(due_s - time.monotonic(), 0.0))
            due_s += 1.0 / FRAME_HZ
            self.near.send(frame, str(time.monotonic_ns()).encode())
        time.sleep(_SETTLE_S)
        seconds: list[float] = json.loads(_asked(self.far))
        return seconds

    def command_s(self) -> float:
        """From asking to the answer."""
        began_s = time.perf_counter()
        self.near.ask(bytes(COMMAND_BYTES))
        return time.perf_counter() - began_s


def main(arguments: Sequence[str] = ()) -> int:
    """Measure, write the page; 0 when both ratios hold."""
    parser = OneLineParser(prog="distalock bench bus", description="frames and commands beside bare Zenoh")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"rounds over the three ({ROUNDS})")
    given: argparse.Namespace = parser.parse_args(list(arguments))
    with measured_side_by_side(given.rounds) as buses:
        report = page(buses)
        print(report)
        REPORT.write_text(report)
        held = ratio(buses, "protected", frames_of) <= FRAME_LIMIT
        return 0 if held and ratio(buses, "protected", commands_of) <= COMMAND_LIMIT else 1


@contextmanager
def measured_side_by_side(rounds: int) -> Iterator[dict[Kind, Bus]]:
    """The three, after all rounds."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        Keystore(folder / PKI_FOLDER).ensure(datetime.now(UTC))
        buses = {kind: _started(kind, folder, stack) for kind in KINDS}
        for bus in buses.values():
            bus.frames(WARM_UP_FRAMES)
        for _ in range(rounds):
            for bus in buses.values():
                bus.round()
        yield buses


def _started(kind: Kind, folder: Path, stack: ExitStack) -> Bus:
    (port,) = free_ports(1)
    endpoint = f"{'tls' if kind == 'protected' else 'tcp'}/127.0.0.1:{port}"
    _process(stack, ["shared.bus.router", "--listen", endpoint, *_router_arguments(kind, folder)])
    deadline_s = time.monotonic() + _START_WITHIN_S
    while not tcp_port_answers(port):
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"the router was not ready within {_START_WITHIN_S:g} s")
        time.sleep(0.05)
    far = _process(stack, ["benchmarks.bus.far_end", kind, endpoint, str(folder)])
    if far.stdout is None or far.stdout.readline().strip() != "ready":
        raise TimeoutError(f"the far end of {kind} did not start")
    return Bus(kind, stack.enter_context(near_end(kind, endpoint, folder)), far)


def _router_arguments(kind: Kind, folder: Path) -> list[str]:
    if kind != "protected":
        return ["--plain-bus"]
    files = TlsFiles.in_state(folder, ROUTER)
    return ["--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key)]


def _process(stack: ExitStack, words: list[str]) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", *words]
    process = stack.enter_context(
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, bufsize=1
        )
    )
    stack.callback(process.terminate)
    return process


def _asked(far: "subprocess.Popen[str]") -> str:
    if far.stdin is None or far.stdout is None:
        raise TimeoutError("the far end cannot be asked")
    far.stdin.write("\n")
    far.stdin.flush()
    return far.stdout.readline()


def frames_of(bus: Bus) -> list[list[float]]:
    """Seconds of each frame, round by round."""
    return bus.frames_s


def commands_of(bus: Bus) -> list[list[float]]:
    """Seconds of each command, round by round."""
    return bus.commands_s


def ratio(buses: dict[Kind, Bus], kind: Kind, figures: Callable[[Bus], list[list[float]]]) -> float:
    """Median over the rounds of the ratio of medians to bare Zenoh's."""
    pairs = zip(figures(buses[kind]), figures(buses["bare"]), strict=True)
    return float(np.median([np.median(own) / np.median(bare) for own, bare in pairs]))


def page(buses: dict[Kind, Bus]) -> str:
    """The report."""
    shortage = shared_memory_shortage(MemoryLimits.of_this_process())
    head = _HEAD.format(len(buses["bare"].frames_s), FRAMES_A_ROUND, FRAME_HZ, COMMANDS_A_ROUND, COMMAND_BYTES)
    rows = "".join(_row(buses, kind) for kind in KINDS)
    limit = f"| limit, for the last | | | | {FRAME_LIMIT:g} | | | {COMMAND_LIMIT:g} |\n"
    way = shortage or "Frames go by shared memory, under TLS too; commands never do."
    load = f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, on {os.cpu_count()}"
    return f"{head}{rows}{limit}\n{way}\n\n{load} processors.\n"


def _row(buses: dict[Kind, Bus], kind: Kind) -> str:
    frames = np.concatenate(buses[kind].frames_s)
    commands = np.concatenate(buses[kind].commands_s)
    sent = FRAMES_A_ROUND * len(buses[kind].frames_s)
    return (
        f"| {_NAMES[kind]} | {_ms(frames, 50)} | {_ms(frames, 99)} | {len(frames)} of {sent} "
        f"| {ratio(buses, kind, frames_of):.2f} | {_ms(commands, 50)} | {_ms(commands, 99)} "
        f"| {ratio(buses, kind, commands_of):.2f} |\n"
    )


def _ms(seconds: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]", percent: int) -> str:
    return f"{1e3 * float(np.percentile(seconds, percent)):.2f} ms"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
