"""Every process killed and stopped (SIGSTOP) in motion: when the robot is at rest and locked, and how far it went.

Real processes and the virtual operating room, over REST. Times are the virtual controller's own, on the monotonic clock
of this machine. Writes docs/benchmarks/robot-process-loss.md.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import httpx

from benchmarks.common.operating_room import running
from benchmarks.common.places import PAGES
from benchmarks.faults.hexapod import Hexapod
from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.demo_user import demo_token
from distalock.installation import Installation, Ports
from distalock.rest_client import RestClient
from distalock.robot_readiness import NotDone, make_robot_ready
from distalock.room_client import RoomClient

SEED = 2
SERVICES = ("robot", "router", "imaging", "registration", "ui_api")
INSTALLATION = "distalock up"
SIGNALS = (signal.SIGKILL, signal.SIGSTOP)
# The requirement: whatever dies, the robot is at rest and locked within half a second and a millimetre.
LIMIT_S, LIMIT_MM = 0.5, 1.0
PATIENCE_S = 240.0
LOOK_FOR_S = 8.0
REPORT = PAGES / "robot-process-loss.md"


@dataclass(frozen=True, slots=True)
class Loss:
    """What a loss in motion came to.

    Attributes
    ----------
    safe_s
        From the signal until the robot was at rest and locked; infinite when it never was, while it was looked at.
    travel_mm
        How far the pivot went in that time.
    """

    process: str
    kind: str
    safe_s: float
    travel_mm: float
    was_unheld: bool

    @property
    def within_limits(self) -> bool:
        """Whether it is what is required."""
        return self.safe_s <= LIMIT_S and self.travel_mm <= LIMIT_MM and not self.was_unheld


@dataclass(slots=True)
class Site:
    """An installation, as a console and a person in the room see it; `case` is opened with the first motion."""

    ports: Ports
    gateway: Client
    control: RestClient
    pids: Callable[[], Mapping[str, int]]
    restart: Callable[[str], None]
    case: CaseClient | None = None

    def hexapod(self) -> Hexapod:
        """The truth about the robot."""
        return Hexapod.model_validate(self.control.get("/controller"))


def lose(site: Site, process: str, number: signal.Signals) -> Loss:
    """Begin to move, send a signal to a process, look until the robot is safe, and make all well again."""
    _begin_to_move(site)
    pid = site.pids()[process]
    before = site.hexapod()
    os.kill(pid, number)
    after = _until_safe(site, before)
    if number is signal.SIGKILL:
        site.restart(process)
    else:
        os.kill(pid, signal.SIGCONT)
    travel_mm = sum((a - b) ** 2 for a, b in zip(after.pose[:3], before.pose[:3], strict=True)) ** 0.5
    safe_s = float("inf") if after.safe_since_s is None else after.safe_since_s - before.clock_s
    return Loss(process, number.name, safe_s, travel_mm, after.was_unheld)


def _begin_to_move(site: Site) -> None:
    """Everything from an image to a motion; once more when the machine was too busy for a deadline on the way."""
    room = RoomClient(site.control)
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            _wait(lambda: httpx.get(f"{site.ports.rest_url}/readyz").is_success)
            make_robot_ready(site.gateway)
            case = site.case = site.case or CaseClient.opened(site.gateway, room.scenario().set_up)
            seen = case.localisation_of(room.take_shot())
            plan = case.plan(seen.number, room.scenario().hole_ids)
            case.approve(plan)
            case.begin_motion(plan)
            _wait(lambda: site.hexapod().moving, within_s=2.0)
        except (RequestRefused, NotDone, TimeoutError, httpx.HTTPError) as error:
            print(f"again: {error}")
        else:
            return
    raise TimeoutError(f"no motion began within {PATIENCE_S:g} s")


def _until_safe(site: Site, before: Hexapod) -> Hexapod:
    now = before
    while now.safe_since_s is None and now.clock_s < before.clock_s + LOOK_FOR_S:
        time.sleep(0.02)
        now = site.hexapod()
    return now


def _wait(condition: Callable[[], bool], within_s: float = PATIENCE_S) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"it did not come about within {within_s:g} s")
        time.sleep(0.01)


@contextmanager
def services_site(folder: Path) -> Iterator[Site]:
    """An installation whose processes belong to this one."""
    installation = Installation(Ports.any_free(), folder, scenario_arguments=("--seed", str(SEED)))
    with running(installation) as room:
        yield Site(installation.ports, room.gateway, room.control, lambda: room.fleet.pids, room.fleet.restart)


@contextmanager
def up_site(folder: Path) -> Iterator[Site]:
    """`distalock up --simulate` in a process of its own."""
    ports = Ports.any_free()
    names = ("router", "rest", "dicom", "gcs", "control")
    options = [word for name in names for word in (f"--{name}-port", str(getattr(ports, name)))]
    command = ["-m", "distalock", "up", "--simulate", "--seed", str(SEED), "--state", str(folder), *options]
    directory = folder / "installation.json"
    with (
        subprocess.Popen([sys.executable, *command], stdout=subprocess.DEVNULL) as up,
        Client(ports.rest_url, demo_token(folder)) as gateway,
        RestClient(ports.control_url) as control,
    ):
        try:
            _wait(directory.exists, within_s=300.0)
            yield Site(ports, gateway, control, lambda: {INSTALLATION: up.pid}, lambda _: None)
        finally:
            up.send_signal(signal.SIGCONT)
            up.terminate()
            if directory.exists():  # those that a killed one has left end by themselves
                left = tuple(json.loads(directory.read_text())["pids"].values())
                _wait(lambda: not any(Path(f"/proc/{pid}").exists() for pid in left))


def measured() -> list[Loss]:
    """Everything once."""
    losses: list[Loss] = []
    with tempfile.TemporaryDirectory() as folder, services_site(Path(folder)) as site:
        for process, number in product(SERVICES, SIGNALS):
            losses.append(lose(site, process, number))
            print(losses[-1], flush=True)
    with tempfile.TemporaryDirectory() as folder, up_site(Path(folder)) as site:
        losses += [lose(site, INSTALLATION, number) for number in reversed(SIGNALS)]
    return losses


def main() -> int:
    """Measure, write the report; 0 when the limits hold."""
    losses = measured()
    report = _report(losses)
    print(report)
    REPORT.write_text(report)
    return 0 if all(loss.within_limits for loss in losses) else 1


def _report(losses: list[Loss]) -> str:
    rows = "".join(
        f"| `{one.process}` | {one.kind} | {1e3 * one.safe_s:.0f} ms | {one.travel_mm:.2f} mm |\n" for one in losses
    )
    return (
        "# A process lost in motion\n\n"
        "Made by `distalock bench process_loss`: each process of an installation killed and stopped while the robot "
        "moves at 2 mm/s.\nFrom the signal until the robot is at rest and locked (brakes on, servos off), and the way "
        "of the pivot in that time, both by the\nvirtual controller. The guide is held by servo or brake at every "
        "moment.\n\n"
        "| process | signal | at rest and locked after | way |\n|---|---|---|---|\n"
        f"{rows}"
        f"| limit | | {1e3 * LIMIT_S:.0f} ms | {LIMIT_MM:.0f} mm |\n\n"
        f"Load average of the five minutes before the end of this run: {os.getloadavg()[1]:.1f}, "
        f"on {os.cpu_count()} processors.\n"
    )


if __name__ == "__main__":
    sys.exit(main())
