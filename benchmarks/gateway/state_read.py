"""State read over the gateway beside the same state over a bare FastAPI route with the same login.

usage: distalock bench state_read [--pairs 2000] [--rounds 5] [--report FILE]

Real processes on both sides. The bare application answers with the very bodies that the gateway gave, from one
`uvicorn` process. One client asks the two in turn on a connection that it keeps to each; who is first changes from pair
to pair. The figure of a round is the ratio of the medians, that of the page the median over the rounds.
"""

import argparse
import http.client
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from benchmarks.common.places import PAGES
from benchmarks.robot.stop_latency_rig import StopRig, stop_rig
from distalock.arguments import whole_number, writable_file
from distalock.local_ports import free_ports
from distalock.rest_client import bearer
from shared.arguments import OneLineParser
from shared.scheduling import ordinary

REPORT: Final = PAGES / "state-read.md"
PAIRS: Final = 2000
ROUNDS: Final = 5
LARGEST_RATIO: Final = 1.5
_WARM_UP: Final = 100
# A machine that is busy otherwise starts processes slowly.
_STARTS_WITHIN_S: Final = 300.0


@dataclass(frozen=True, slots=True)
class Round:
    """Seconds for each answer of one round, the gateway's and the bare route's."""

    gateway_s: tuple[float, ...]
    bare_s: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Of the medians."""
        return median(self.gateway_s) / median(self.bare_s)


@dataclass(frozen=True, slots=True)
class Read:
    """All rounds of one state."""

    name: str
    body_bytes: int
    rounds: tuple[Round, ...]

    @property
    def ratio(self) -> float:
        """Median over the rounds."""
        return median(one.ratio for one in self.rounds)


class Reader:
    """Reads one path again and again on one connection."""

    def __init__(self, port: int, path: str, headers: Mapping[str, str]) -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
        self._path, self._headers = path, dict(headers)

    def read(self) -> bytes:
        """The body; raises `RuntimeError` when it was refused."""
        self._connection.request("GET", self._path, headers=self._headers)
        response = self._connection.getresponse()
        body = response.read()
        if response.status != http.HTTPStatus.OK:
            raise RuntimeError(f"GET {self._path}: {response.status} {body.decode(errors='replace')}")
        return body

    def seconds(self) -> float:
        """How long it takes."""
        began_s = time.perf_counter()
        self.read()
        return time.perf_counter() - began_s


def paired(gateway: Reader, bare: Reader, pairs: int) -> Round:
    """One round: pairs of readings, who is first in turn."""
    for _ in range(_WARM_UP):
        gateway.read()
        bare.read()
    seconds: dict[Reader, list[float]] = {gateway: [], bare: []}
    for number in range(pairs):
        for reader in (gateway, bare) if number % 2 else (bare, gateway):
            seconds[reader].append(reader.seconds())
    return Round(tuple(seconds[gateway]), tuple(seconds[bare]))


@contextmanager
def _bare_process(token: str, bodies: Mapping[str, Path]) -> Iterator[int]:
    """The bare application in a process of its own; its port."""
    (port,) = free_ports(1)
    words = [word for name, file in bodies.items() for word in (f"--{name}", str(file))]
    command = [sys.executable, "-m", "benchmarks.gateway.bare_route", "--port", str(port), *words]
    with ordinary():
        process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
    try:
        assert process.stdin is not None
        process.stdin.write(f"{token}\n")
        process.stdin.flush()
        _wait_for(port, token)
        yield port
    finally:
        process.terminate()
        process.wait()


def _wait_for(port: int, token: str) -> None:
    deadline_s = time.monotonic() + _STARTS_WITHIN_S
    while True:
        try:
            Reader(port, "/api/v1/robot", bearer(token)).read()
        except OSError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)
        else:
            return


def measured(rig: StopRig, pairs: int, rounds: int) -> list[Read]:
    """Robot and case, each in so many rounds."""
    ports, token = rig.installation.ports, rig.installation.token
    rig.make_ready()
    paths = {"robot": "/api/v1/robot", "case": f"/api/v1/cases/{rig.case[0]}"}
    bodies = {name: Reader(ports.rest, path, bearer(token)).read() for name, path in paths.items()}
    files = {name: rig.installation.state_dir / f"bare-{name}.json" for name in bodies}
    for name, file in files.items():
        file.write_bytes(bodies[name])
    found: dict[str, list[Round]] = {name: [] for name in paths}
    with _bare_process(token, files) as bare_port:
        for _ in range(rounds):
            for name, path in paths.items():
                gateway, bare = (Reader(port, path, bearer(token)) for port in (ports.rest, bare_port))
                found[name].append(paired(gateway, bare, pairs))
    return [Read(paths[name].replace(rig.case[0], "{id}"), len(bodies[name]), tuple(found[name])) for name in paths]


def main(arguments: Sequence[str] = ()) -> int:
    """Measure and write the page; 1 when a ratio is above its limit."""
    given = _options(arguments)
    with stop_rig() as rig:
        reads = measured(rig, given.pairs, given.rounds)
    page = page_of(reads, given.pairs)
    given.report.write_text(page)
    print(page)
    return 0 if all(read.ratio <= LARGEST_RATIO for read in reads) else 1


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench state_read", description="state over the gateway and a bare route")
    pairs = whole_number("a number of pairs", 2, 10**6)
    parser.add_argument("--pairs", type=pairs, default=PAIRS, help=f"of each state and round ({PAIRS})")
    rounds = whole_number("a number of rounds", 1, 1000)
    parser.add_argument("--rounds", type=rounds, default=ROUNDS, help=f"rounds ({ROUNDS})")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the page")
    return parser.parse_args(list(arguments))


def page_of(reads: Sequence[Read], pairs: int) -> str:
    """The page."""
    return (
        "# State read over the gateway and over a bare FastAPI route\n\n"
        f"Made by `distalock bench state_read`: {len(reads[0].rounds)} rounds of {pairs} pairs for each state. One "
        "client asks the gateway (front and application,\ntwo processes) and a bare FastAPI application (one process, "
        "one route, the same login and the same body) in turn, on a connection that it\nkeeps to each.\n\n"
        "| `GET` | body | gateway: median | 99 % | bare: median | 99 % | ratio of medians | rounds |\n"
        "|---|---|---|---|---|---|---|---|\n"
        f"{''.join(map(_row, reads))}"
        f"| limit | | | | | | {LARGEST_RATIO:g} | |\n\n"
        f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, "
        f"on {os.cpu_count()} processors.\n"
    )


def _row(read: Read) -> str:
    gateway_s = [value for one in read.rounds for value in one.gateway_s]
    bare_s = [value for one in read.rounds for value in one.bare_s]
    least, most = min(one.ratio for one in read.rounds), max(one.ratio for one in read.rounds)
    return (
        f"| `{read.name}` | {read.body_bytes} bytes | {_quantiles(gateway_s)} | {_quantiles(bare_s)} "
        f"| {read.ratio:.2f} | {least:.2f} to {most:.2f} |\n"
    )


def _quantiles(seconds: Sequence[float]) -> str:
    return " | ".join(f"{1e3 * np.percentile(seconds, percent):.2f} ms" for percent in (50.0, 99.0))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
