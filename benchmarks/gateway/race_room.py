"""The room in which surgeons race: an installation with the virtual room, a plan for each race, what is left of it."""

import random
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.faults.line_relay import line_relay
from benchmarks.gateway.accepted_view import accepted_localisation
from benchmarks.gateway.race_judgement import Commanded, MoveOperation
from distalock.case_client import CaseClient
from distalock.client import RequestRefused
from distalock.client.models import LocalisationView, PlanView
from distalock.installation import Installation, Ports
from distalock.processes import ProcessSpec
from distalock.rest_client import JsonObject
from distalock.robot_readiness import make_robot_ready

_CONTROLLER_URL: Final = "DISTALOCK_ROBOT_CONTROLLER_URL"
_STOP: Final = b"\x18"
_MOVE: Final = b"MOV "
# Chosen: motions of one to two seconds, within the legs' reach.
_MOUNT_SLIPS_MM: Final = 3.0
_MOST_TRIES: Final = 10
_PATIENCE_S: Final = 60.0
_POLL_S: Final = 0.02


class OverheardLine:
    """Notes what goes to the controller that moves it or stops it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._commanded: list[Commanded] = []
        self._unfinished = b""

    def hear(self, content: bytes) -> None:
        """Take in some bytes; a stop is one byte, wherever it stands."""
        now_s = time.monotonic()
        with self._lock:
            self._commanded += [Commanded(now_s, "stop") for _ in range(content.count(_STOP))]
            *lines, self._unfinished = (self._unfinished + content.replace(_STOP, b"")).split(b"\n")
            self._commanded += [Commanded(now_s, "move") for line in lines if line.lstrip(b"\x05").startswith(_MOVE)]

    def taken(self) -> tuple[Commanded, ...]:
        """What was heard since it was asked last."""
        with self._lock:
            commanded, self._commanded = self._commanded, []
        return tuple(commanded)


@dataclass(slots=True)
class RaceRoom:
    """A case with a robot that can move, and how it is brought there again after each race."""

    room: OperatingRoom
    line: OverheardLine
    case: CaseClient
    hole_ids: tuple[str, ...]
    seen: LocalisationView | None = None

    def plan(self, source: random.Random, *, moved: bool) -> PlanView:
        """A plan that moves the robot by some millimetres; where it `moved`, its mount slips, and an image is taken."""
        for _ in range(_MOST_TRIES):
            make_robot_ready(self.room.gateway)  # a busy machine may have stopped it again
            if moved or self.seen is None:
                self.seen = self._localised(source)
            try:
                return self.case.plan(self.seen.number, self.hole_ids)
            except RequestRefused as refusal:
                last, self.seen = refusal, None
        raise RuntimeError(f"no plan after {_MOST_TRIES} images: {last}")

    def _localised(self, source: random.Random) -> LocalisationView:
        shift = [source.uniform(-_MOUNT_SLIPS_MM, _MOUNT_SLIPS_MM) for _ in range(3)]
        self.room.control.post("/faults", {"kind": "mount_shift", "shift_mm": shift})
        self.case.record_step("mount_moved", why="so that there is something to move")
        return accepted_localisation(self.room, self.case, source)

    def operations(self, plan: int) -> tuple[MoveOperation, ...]:
        """Motions from a plan, once they have ended, or did not in a minute."""
        deadline_s = time.monotonic() + _PATIENCE_S
        while True:
            of_plan = [one for one in self._all_operations() if one["plan"] == plan]
            ended = [one["status"] in ("succeeded", "failed", "stopped") for one in of_plan]
            if all(ended) or time.monotonic() > deadline_s:
                return tuple(
                    MoveOperation(str(one["id"]), done, None if one["began"] is None else one["began"] is True)
                    for one, done in zip(of_plan, ended, strict=True)
                )
            time.sleep(_POLL_S)

    def _all_operations(self) -> list[JsonObject]:
        """The newest; a race has a few."""
        items = self.room.rest.get("/api/v1/operations?sort=newest&limit=50")["items"]
        assert isinstance(items, list)
        return items

    def stop_is_latched(self) -> bool:
        """Whether the robot says that a stop is in force."""
        state = self.room.rest.get("/api/v1/robot")["state"]
        return isinstance(state, dict) and state["stop"] == "latched"

    def is_at_rest(self) -> bool:
        """Whether the hexapod stands still, by the virtual room's own truth."""
        return self.room.control.get("/controller")["moving"] is False


@contextmanager
def race_room(seed: int) -> Iterator[RaceRoom]:
    """Start an installation and open its case; nothing is left behind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="distalock-races-")))
        installation = Installation(Ports.any_free(), folder, scenario_arguments=("--seed", str(seed)))
        line = OverheardLine()
        relay = stack.enter_context(line_relay(installation.ports.gcs, line.hear))

        def overheard(spec: ProcessSpec) -> ProcessSpec:
            if _CONTROLLER_URL not in spec.environment:
                return spec
            return replace(spec, environment={**spec.environment, _CONTROLLER_URL: f"socket://127.0.0.1:{relay.port}"})

        room = stack.enter_context(running(installation, overheard))
        make_robot_ready(room.gateway)
        yield RaceRoom(room, line, room.open_case(), room.room.scenario().hole_ids)
