"""A room in which surgeons race: what a race needs of it, however its plans are made."""

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from benchmarks.gateway.race_judgement import Commanded, MoveOperation
from distalock.client.models import PlanView
from distalock.rest_client import JsonObject, RestClient

# `images`: of images taken in the virtual operating room. `stand_in`: the benchmark answers for registration.
PlansFrom = Literal["images", "stand_in"]
_STOP: Final = b"\x18"
_MOVE: Final = b"MOV "
_PATIENCE_S: Final = 60.0
_POLL_S: Final = 0.02


class NoPlan(Exception):
    """The room could not be brought to where there is a plan, for the reason given."""


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


@dataclass(frozen=True, slots=True)
class RaceRoom:
    """An open case with a robot that can move.

    Attributes
    ----------
    plan
        Brings the robot to where it may move, and makes a plan that moves it by some millimetres; raises `NoPlan`.
    is_at_rest
        Whether the hexapod stands still, by the virtual controller's own truth.
    """

    plans_from: PlansFrom
    rest: RestClient
    url: str
    state_dir: Path
    case_id: str
    line: OverheardLine
    plan: Callable[[random.Random], PlanView]
    is_at_rest: Callable[[], bool]

    def operations(self, plan: int) -> tuple[MoveOperation, ...]:
        """Motions from a plan, once they have ended, or did not in a minute."""
        deadline_s = time.monotonic() + _PATIENCE_S
        while True:
            of_plan = [one for one in self._newest_operations() if one["plan"] == plan]
            ended = [one["status"] in ("succeeded", "failed", "stopped") for one in of_plan]
            if all(ended) or time.monotonic() > deadline_s:
                return tuple(
                    MoveOperation(str(one["id"]), done, None if one["began"] is None else one["began"] is True)
                    for one, done in zip(of_plan, ended, strict=True)
                )
            time.sleep(_POLL_S)

    def _newest_operations(self) -> list[JsonObject]:
        """A race has a few."""
        items = self.rest.get("/api/v1/operations?sort=newest&limit=50")["items"]
        assert isinstance(items, list)
        return items

    def stop_is_latched(self) -> bool:
        """Whether the robot says that a stop is in force."""
        state = self.rest.get("/api/v1/robot")["state"]
        return isinstance(state, dict) and state["stop"] == "latched"
