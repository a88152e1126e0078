"""A race room without images: real router, gateway and robot; this process stands in for registration.

Nobody of those whose requests race waits for registration, and an image with its localisation takes longer than a race.
"""

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from benchmarks.gateway.race_room import NoPlan, OverheardLine, RaceRoom
from benchmarks.gateway.stand_in_registration import StandInRegistration
from benchmarks.robot.plans import HEXAPOD, HOLE_IDS, plan_between, random_target
from benchmarks.robot.stop_latency_rig import ListeningController, StopRig, stop_rig
from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.client.models import PlanView
from distalock.robot_readiness import NotDone, make_robot_ready
from shared.messages.robot import MotionState
from simulation.controller.gcs_protocol import SingleByte

# Chosen: poses within that of the middle, in mm and degrees, for motions of about half a second.
_TARGET_SIZE: Final = 1.0
_MOST_TRIES: Final = 5


class OverheardController(ListeningController):
    """Notes what moves or stops it, in the order in which it came."""

    def __init__(self, line: OverheardLine) -> None:
        super().__init__(HEXAPOD, time.monotonic)
        self._line = line

    def receive(self, command: str | SingleByte) -> bytes:
        """Note, then obey."""
        if isinstance(command, SingleByte):
            self._line.hear(bytes([command]))
        else:
            self._line.hear(command.encode() + b"\n")
        return super().receive(command)


@dataclass(frozen=True, slots=True)
class OfferedPlans:
    """Makes plans to somewhere near."""

    rig: StopRig
    gateway: Client
    case: CaseClient
    registration: StandInRegistration

    def plan(self, source: random.Random) -> PlanView:
        """From where the robot stands, once it is locked."""
        last: Exception | None = None
        for _ in range(_MOST_TRIES):
            try:
                make_robot_ready(self.gateway, settles_s=0.0)
                state = self.rig.wait(lambda s: s.state is MotionState.LOCKED and s.locked is True)
                if state.pose is None:
                    continue
                start, target = state.pose.value(), random_target(source, _TARGET_SIZE)
                offered = plan_between(start, target, self.rig.epoch, state.boot_epoch, self.rig.case)
                return self.case.plan(self.registration.offer(offered), HOLE_IDS)
            except (RequestRefused, NotDone, TimeoutError) as odd:
                last = odd
        raise NoPlan(f"no plan after {_MOST_TRIES} attempts: {last}")

    def is_at_rest(self) -> bool:
        """Whether the hexapod stands still."""
        return not self.rig.controller.snapshot().moving


@contextmanager
def room_with_stand_in() -> Iterator[RaceRoom]:
    """Start the processes and open a case; nothing is left behind."""
    line = OverheardLine()
    with stop_rig(OverheardController(line)) as rig:
        url, token = rig.installation.ports.rest_url, rig.installation.token
        with Client(url, token) as gateway:
            case = CaseClient(gateway, rig.case[0])
            plans = OfferedPlans(rig, gateway, case, StandInRegistration(rig))
            state_dir = rig.installation.state_dir
            yield RaceRoom("stand_in", rig.rest, url, state_dir, case.id, line, plans.plan, plans.is_at_rest)
