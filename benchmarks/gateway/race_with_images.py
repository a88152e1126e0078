"""A race room with everything that is real: each plan is of images that were taken in the virtual operating room."""

import random
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from benchmarks.common.operating_room import WITHOUT_RATE_LIMITS, OperatingRoom, running
from benchmarks.faults.line_relay import line_relay
from benchmarks.gateway.accepted_view import accepted_localisation
from benchmarks.gateway.race_room import NoPlan, OverheardLine, RaceRoom
from distalock.case_client import CaseClient
from distalock.client import RequestRefused
from distalock.client.models import LocalisationView, PlanView
from distalock.installation import Installation, Ports
from distalock.processes import ProcessSpec
from distalock.rest_client import JsonObject
from distalock.robot_readiness import NotDone, make_robot_ready

_CONTROLLER_URL: Final = "DISTALOCK_ROBOT_CONTROLLER_URL"
# Chosen: short motions that are well within the legs' reach.
_MOUNT_SLIPS_MM: Final = 1.5
_MOST_TRIES: Final = 5


@dataclass(slots=True)
class ImagedPlans:
    """Makes plans. One image serves all races until the robot has moved."""

    room: OperatingRoom
    case: CaseClient
    hole_ids: tuple[str, ...]
    first_view: JsonObject
    seen: LocalisationView | None = None

    def plan(self, source: random.Random) -> PlanView:
        """From the newest image, if it still holds, or from a new one after the mount has slipped a little."""
        last: Exception | None = None
        for _ in range(_MOST_TRIES):
            try:
                make_robot_ready(self.room.gateway)
                if self.seen is None:
                    self.seen = self._localised(source)
                return self.case.plan(self.seen.number, self.hole_ids)
            except RequestRefused as refusal:  # most often because the robot has moved since the image
                last, self.seen = refusal, None
            except (RuntimeError, TimeoutError, NotDone) as odd:
                print(f"no localisation: {odd}", flush=True)
                last, self.seen = odd, None
                self.room.control.put("/c-arm", self.first_view)
        raise NoPlan(f"no plan after {_MOST_TRIES} attempts: {last}")

    def _localised(self, source: random.Random) -> LocalisationView:
        shift = [source.uniform(-_MOUNT_SLIPS_MM, _MOUNT_SLIPS_MM) for _ in range(3)]
        self.room.control.post("/faults", {"kind": "mount_shift", "shift_mm": shift})
        self.case.record_step("mount_moved", why="so that there is something to move")
        return accepted_localisation(self.room, self.case, source)

    def is_at_rest(self) -> bool:
        """Whether the hexapod stands still."""
        return self.room.control.get("/controller")["moving"] is False


@contextmanager
def room_with_images(seed: int) -> Iterator[RaceRoom]:
    """Start an installation and open its case; nothing is left behind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="distalock-races-")))
        installation = Installation(Ports.any_free(), folder, scenario_arguments=("--seed", str(seed)))
        line = OverheardLine()
        relay = stack.enter_context(line_relay(installation.ports.gcs, line.hear))

        def overheard(spec: ProcessSpec) -> ProcessSpec:
            environment = {**spec.environment, **WITHOUT_RATE_LIMITS}
            if _CONTROLLER_URL in environment:
                environment[_CONTROLLER_URL] = f"socket://127.0.0.1:{relay.port}"
            return replace(spec, environment=environment)

        room = stack.enter_context(running(installation, overheard))
        make_robot_ready(room.gateway)
        case = room.open_case()
        plans = ImagedPlans(room, case, room.room.scenario().hole_ids, room.control.get("/c-arm"))
        url = installation.ports.rest_url
        yield RaceRoom("images", room.rest, url, folder, case.id, line, plans.plan, plans.is_at_rest)
