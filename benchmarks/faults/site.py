"""The installation that the faults meet: its processes with a clock, a line and disks that can be tampered with."""

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.faults.acknowledged import Acknowledged
from benchmarks.faults.hexapod import Hexapod
from benchmarks.faults.line_relay import LineRelay, line_relay
from benchmarks.faults.small_disks import small_disk
from benchmarks.faults.stepped_clock import ClockFile, stepped_environment
from distalock.installation import Installation, Ports
from distalock.processes import ProcessSpec
from services.ui_api.record.database import sqlite_url

# The processes of the product, in the order in which they are started; the virtual operating room is no part of it.
HARDWARE: Final = "virtual-or"
PROCESSES: Final = tuple(s.name for s in Installation(Ports(), Path()).specs() if s.name != HARDWARE)
# Processes that others start and watch over: who, and a word of the command line.
CHILDREN: Final[Mapping[str, tuple[str, str]]] = {
    "guardian": ("robot", "guardian_process"),
    "application": ("ui_api", "services.ui_api.application"),
}
_CONTROLLER_URL: Final = "DISTALOCK_ROBOT_CONTROLLER_URL"
# Ten times what a pass needs, a storm of images included.
_STATE_MIB, _RECORD_MIB = 768, 256


@dataclass(frozen=True, slots=True)
class FaultSite:
    """A running installation, and the handles that faults take it by."""

    room: OperatingRoom
    line: LineRelay
    clock: ClockFile
    acknowledged: Acknowledged

    @property
    def state_dir(self) -> Path:
        """Folder of keys, images and logs."""
        return self.room.installation.state_dir

    @property
    def record_file(self) -> Path:
        """The case record, on a disk of its own."""
        return record_folder(self.state_dir) / "case-record.sqlite"

    @property
    def pids(self) -> Mapping[str, int]:
        """Process ids of the product by name."""
        return {name: pid for name, pid in self.room.fleet.pids.items() if name != HARDWARE}

    @property
    def all_pids(self) -> tuple[int, ...]:
        """Process ids of the whole product."""
        return tuple(self.pid(name) for name in (*PROCESSES, *CHILDREN))

    def pid(self, name: str) -> int:
        """Process id of a process of the product, also of one that another one has started."""
        if name not in CHILDREN:
            return self.pids[name]
        parent, word = CHILDREN[name]
        children = Path(f"/proc/{self.pids[parent]}/task").glob("*/children")
        pids = [int(number) for file in children for number in file.read_text().split()]
        return next(pid for pid in pids if word in Path(f"/proc/{pid}/cmdline").read_text())

    def hexapod(self) -> Hexapod:
        """The truth about the robot."""
        return Hexapod.model_validate(self.room.control.get("/controller"))


def record_folder(state_dir: Path) -> Path:
    """Where the case record lies."""
    return state_dir / "record"


@contextmanager
def fault_site(seed: int) -> Iterator[FaultSite]:
    """Start an installation with a scenario; everything is gone afterwards."""
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="distalock-faults-"))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        state = folder / "state"
        stack.enter_context(small_disk(state, _STATE_MIB))
        stack.enter_context(small_disk(record_folder(state), _RECORD_MIB))
        installation = Installation(Ports.any_free(), state, scenario_arguments=("--seed", str(seed)))
        clock = ClockFile(folder / "clock")
        line = stack.enter_context(line_relay(installation.ports.gcs))

        def tampered(spec: ProcessSpec) -> ProcessSpec:
            return _with_handles(spec, clock, line)

        yield FaultSite(stack.enter_context(running(installation, tampered)), line, clock, Acknowledged())


def _with_handles(spec: ProcessSpec, clock: ClockFile, line: LineRelay) -> ProcessSpec:
    if spec.name == HARDWARE:
        return spec
    environment = {**spec.environment, **stepped_environment(clock)}
    state_dir = environment.get("DISTALOCK_STATE_DIR")
    if state_dir is not None:
        environment["DISTALOCK_UI_API_DATABASE_URL"] = sqlite_url(record_folder(Path(state_dir)))
    if _CONTROLLER_URL in environment:
        environment[_CONTROLLER_URL] = f"socket://127.0.0.1:{line.port}"
    return replace(spec, environment=environment)
