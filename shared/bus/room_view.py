"""What an exporter knows of its room, and the summary of it: no bus, no clock of its own."""

import threading
from typing import Final, Literal

from pydantic import BaseModel, ConfigDict

from shared.bus.access import SERVICES
from shared.messages.cases import CaseContext
from shared.messages.presence import ServiceName, ServiceStatus
from shared.messages.refusals import BusRefusals
from shared.messages.site import RobotSummary, RoomSummary, ServiceSummary
from shared.robot_states import MotionState, StopLatch

# Chosen: a sentence; a summary is read by people, and sent forty times a second to a desk of forty rooms.
_LONGEST_DETAIL: Final = 200
Condition = Literal["starting", "ready", "degraded", "stopping", "unknown"]


class RobotGlance(BaseModel):
    """What is shown of a `RobotState`, whose own module needs arrays: an exporter runs beside a router, without any."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    state: MotionState
    stop: StopLatch
    locked: bool
    detail: str = ""


class RoomView:
    """Keeps the newest of each message, from any thread."""

    def __init__(self, room: str, exporter_epoch: str) -> None:
        self._room, self._epoch = room, exporter_epoch
        self._lock = threading.Lock()
        self._alive: set[str] = set()
        self._statuses: dict[str, ServiceStatus] = {}
        self._robot: RobotGlance | None = None
        self._robot_at_s = 0.0
        self._case_id: str | None = None
        self._refusals: BusRefusals | None = None
        self._sequence = 0
        self._sent: RoomSummary | None = None

    def note_alive(self, service: ServiceName, *, alive: bool) -> None:
        """A liveliness token came or went."""
        with self._lock:
            (self._alive.add if alive else self._alive.discard)(service)

    def note_status(self, status: ServiceStatus) -> None:
        """A service reported its condition."""
        with self._lock:
            self._statuses[status.service] = status

    def note_robot(self, state: RobotGlance, now_s: float) -> None:
        """The robot published its state."""
        with self._lock:
            self._robot, self._robot_at_s = state, now_s

    def note_case(self, case: CaseContext) -> None:
        """The gateway opened or closed a case. Part files and set-up stay in the room."""
        with self._lock:
            self._case_id = case.case_id

    def note_refusals(self, refusals: BusRefusals) -> None:
        """The room's router counted refusals."""
        with self._lock:
            self._refusals = refusals

    def summary(self, now_s: float, *, link_up: bool) -> RoomSummary:
        """The room now."""
        with self._lock:
            refusals = self._refusals
            return RoomSummary(
                room=self._room,
                exporter_epoch=self._epoch,
                sequence=self._sequence,
                link_up=link_up,
                services=tuple(self._service(name) for name in SERVICES),
                robot=self._robot_summary(now_s),
                case_id=self._case_id,
                messages_denied=0 if refusals is None else refusals.messages_denied,
                links_refused=0 if refusals is None else refusals.links_refused,
            )

    def changed(self, now_s: float, *, link_up: bool) -> RoomSummary | None:
        """The room now, when it differs from what was sent last by more than the age of what is in it."""
        summary = self.summary(now_s, link_up=link_up)
        return None if self._sent is not None and _timeless(summary) == _timeless(self._sent) else summary

    def note_sent(self, summary: RoomSummary) -> None:
        """A summary was published; the next one has another number."""
        with self._lock:
            self._sent, self._sequence = summary, summary.sequence + 1

    def _service(self, name: ServiceName) -> ServiceSummary:
        status = self._statuses.get(name)
        condition: Condition = "unknown" if status is None else status.condition
        return ServiceSummary(
            service=name,
            alive=name in self._alive,
            condition=condition,
            version="" if status is None else status.version,
            detail="" if status is None else status.detail[:_LONGEST_DETAIL],
        )

    def _robot_summary(self, now_s: float) -> RobotSummary | None:
        if self._robot is None:
            return None
        return RobotSummary(
            state=self._robot.state,
            stop=self._robot.stop,
            locked=self._robot.locked,
            age_s=max(now_s - self._robot_at_s, 0.0),
            detail=self._robot.detail[:_LONGEST_DETAIL],
        )


def _timeless(summary: RoomSummary) -> RoomSummary:
    """A summary without what counts up by itself."""
    robot = None if summary.robot is None else summary.robot.model_copy(update={"age_s": 0.0})
    return summary.model_copy(update={"sequence": 0, "robot": robot})
