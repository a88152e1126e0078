"""`distalock bench upgrade`: a running room upgraded service by service from an earlier revision, and taken back.

usage: distalock bench upgrade [--from REVISION] [--seed 2] [--report FILE]

Every service runs from the sources of the earlier revision first. After each change of one service a whole procedure is
led with old and new ones side by side, by the command of the gateway's version, as people have it; services change in
the order of `docs/releases.md`.
"""

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.common.places import PAGES, ROOT
from benchmarks.upgrade.old_sources import environment_of, last_release, old_sources, running_from
from distalock.installation import Installation, Ports
from distalock.processes import Fleet, ProcessSpec
from distalock.running_procedure import wait_until_usable
from distalock.version import revision
from shared.arguments import OneLineParser
from shared.errors import DistalockError

REPORT: Final = PAGES / "upgrade.md"
_GATEWAY: Final = "ui_api"
# The gateway sends part files, in which a field may be new, so who reads them is changed before it: `docs/releases.md`.
ORDER: Final = ("router", "robot", "registration", "imaging", "ui_api")
_READY_WITHIN_S: Final = 300.0


@dataclass(frozen=True, slots=True)
class Step:
    """One change of the room, and the procedure after it.

    Attributes
    ----------
    ready_s
        From the end of the old process until `readyz` had everything again.
    wrong
        What did not hold; empty when both holes were drilled.
    """

    what: str
    ready_s: float
    took_s: float
    wrong: str


def main(arguments: Sequence[str] = ()) -> int:
    """Upgrade and take back; 0 when every procedure ended with both holes drilled."""
    parser = OneLineParser(prog="distalock bench upgrade", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--from", dest="old", metavar="REVISION", help="what runs at first (the last tagged release)")
    parser.add_argument("--seed", type=int, default=2, help="scenario of the virtual room (2)")
    parser.add_argument("--report", type=Path, default=REPORT, help="file for the page")
    given = parser.parse_args(list(arguments))
    old, steps = given.old or last_release(), list[Step]()
    with (
        tempfile.TemporaryDirectory(prefix="distalock-upgrade-") as folder,
        _room(old, Path(folder), given.seed) as room,
    ):
        for step in _steps(room):
            steps.append(step)
            print(f"{step.what}: ready after {step.ready_s:.1f} s, {step.wrong or 'drilled'}", flush=True)
    text = page(old, steps)
    given.report.write_text(text, encoding="utf-8")
    print(text)
    return int(any(step.wrong for step in steps))


@dataclass(frozen=True, slots=True)
class Room:
    """A running installation whose services come from one of two places."""

    installation: Installation
    fleet: Fleet
    old: Path

    def change(self, name: str, *, to_old: bool) -> float:
        """End a service, start it from the other place; seconds until everything is ready again."""
        began_s = time.monotonic()
        source = running_from(self.old) if to_old else {"PYTHONPATH": "", "PYTHONSAFEPATH": ""}
        self.fleet.restart(name, lambda spec: replace(spec, environment={**spec.environment, **source}))
        wait_until_usable(self.installation.gateway, _READY_WITHIN_S)
        return time.monotonic() - began_s

    def procedure(self, gateway_from: Path) -> str:
        """Lead a whole case with the command of the gateway's version; empty when both holes were drilled."""
        installation = self.installation
        token = self.old.parent / "token"
        token.write_text(installation.token, encoding="ascii")
        token.chmod(0o600)
        words = [sys.executable, "-m", "distalock", "procedure", "--rest", installation.gateway.url]
        words += ["--room", installation.ports.control_url, "--token-file", str(token)]
        if (authority := installation.gateway.authority) is not None:
            words += ["--authority", str(authority)]
        ended = subprocess.run(
            words, env=environment_of(gateway_from), cwd=gateway_from, capture_output=True, text=True, check=False
        )
        said = [*ended.stdout.splitlines(), *ended.stderr.splitlines()] or ["it said nothing"]
        print("".join(f"  {line}\n" for line in said), end="", flush=True)
        return "" if ended.returncode == 0 else said[-1]


@contextmanager
def _room(old: str, folder: Path, seed: int) -> Iterator[Room]:
    sources = old_sources(old, folder / "old")
    installation = Installation(Ports.any_free(), folder / "state", scenario_arguments=("--seed", str(seed)))
    from_old = running_from(sources)

    def changed(spec: ProcessSpec) -> ProcessSpec:
        """The virtual room stands for hardware, and stays."""
        return spec if spec.name == "virtual-or" else replace(spec, environment={**spec.environment, **from_old})

    with installation.fleet(threading.Event(), _READY_WITHIN_S, changed) as fleet:
        yield Room(installation, fleet, sources)


def _steps(room: Room) -> Iterator[Step]:
    wait_until_usable(room.installation.gateway, _READY_WITHIN_S)
    gateway_from = room.old
    yield _step("all of before", room, lambda: 0.0, gateway_from)
    for name in ORDER:
        gateway_from = ROOT if name == _GATEWAY else gateway_from
        yield _step(f"{name} upgraded", room, partial(room.change, name, to_old=False), gateway_from)
    for name in reversed(ORDER):
        gateway_from = room.old if name == _GATEWAY else gateway_from
        yield _step(f"{name} taken back", room, partial(room.change, name, to_old=True), gateway_from)


def _step(what: str, room: Room, change: Callable[[], float], gateway_from: Path) -> Step:
    """A change and the procedure after it; the room goes on when one of them fails."""
    ready_s, began_s = 0.0, time.monotonic()
    try:
        ready_s, began_s = change(), time.monotonic()
        wrong = room.procedure(gateway_from)
    except (DistalockError, TimeoutError) as error:
        return Step(what, ready_s, time.monotonic() - began_s, f"{type(error).__name__}: {error}")
    return Step(what, ready_s, time.monotonic() - began_s, wrong)


def page(old: str, steps: Sequence[Step]) -> str:
    """The page."""
    rows = "".join(
        f"| {step.what} | {step.ready_s:.1f} s | {step.took_s:.0f} s | {step.wrong or 'both holes drilled'} |\n"
        for step in steps
    )
    return f"""# A running room upgraded and taken back

Made by `distalock bench upgrade` from revision `{old}` to `{revision() or "unknown"}`. Services change one
after the other in a room that runs, and a whole procedure is led after each change, with old and new ones side by
side. The record is migrated when the gateway changes. How to do it: [releases](../releases.md#upgrade).

| then | ready again after | procedure took | it ended |
|---|---|---|---|
{rows}"""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
