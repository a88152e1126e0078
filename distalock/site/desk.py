"""The control desk: what rooms show of themselves, and which of them has fallen silent."""

import json
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from rich.console import Console
from rich.live import Live
from rich.table import Table

from shared.bus.port import Sample
from shared.bus.settings import BusSettings
from shared.bus.site import ANY_SUMMARY
from shared.bus.zenoh_bus import open_bus
from shared.messages.base import decode
from shared.messages.site import RobotSummary, RoomSummary
from shared.robot_states import MotionState
from shared.signals import set_by_signals

EXIT_ATTENTION: Final = 3
# Chosen: three repetitions of a room that does not change.
SILENT_AFTER_S: Final = 3.0
_LOOK_EVERY_S: Final = 0.5
# Chosen: summaries that are kept for late joiners arrive well within it.
_FIRST_WITHIN_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class SeenRoom:
    """A room's newest summary, and how long ago it came, by this machine's clock."""

    summary: RoomSummary
    age_s: float

    @property
    def why_attention(self) -> str:
        """Why somebody should call there; empty when the room is well."""
        if self.age_s > SILENT_AFTER_S:
            return f"silent for {self.age_s:.0f} s"
        if not self.summary.link_up:
            return "its exporter does not reach its router"
        missing = [one.service for one in self.summary.services if not one.alive]
        if missing:
            return f"not there: {', '.join(missing)}"
        unwell = [one for one in self.summary.services if one.condition != "ready"]
        if unwell:
            return f"{unwell[0].service} {unwell[0].condition}: {unwell[0].detail}".rstrip(": ")
        return _robot_trouble(self.summary.robot)


def _robot_trouble(robot: RobotSummary | None) -> str:
    if robot is None:
        return "nothing is known of its robot"
    return f"robot: {robot.detail or robot.state}" if robot.state is MotionState.FAULT else ""


class Desk:
    """Keeps the newest summary of each room."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: dict[str, tuple[RoomSummary, float]] = {}
        self._changed: list[RoomSummary] = []

    def on_sample(self, sample: Sample) -> None:
        """A room has shown itself."""
        summary = decode(RoomSummary, sample.payload)
        with self._lock:
            self._seen[summary.room] = (summary, time.monotonic())
            self._changed.append(summary)

    def rooms(self) -> tuple[SeenRoom, ...]:
        """All that have shown themselves, by name."""
        now_s = time.monotonic()
        with self._lock:
            return tuple(SeenRoom(summary, now_s - at_s) for _, (summary, at_s) in sorted(self._seen.items()))

    def taken(self) -> list[RoomSummary]:
        """What came since the last call."""
        with self._lock:
            changed, self._changed = self._changed, []
            return changed


def show_rooms(settings: BusSettings, *, as_json: bool, once: bool) -> int:
    """Show rooms until SIGTERM or Ctrl-C; raises `BusUnavailable` when the site's router does not answer."""
    desk, stop = Desk(), threading.Event()
    with open_bus(settings) as bus, set_by_signals(stop):
        bus.subscribe_retained(ANY_SUMMARY, desk.on_sample)
        if once:
            stop.wait(_FIRST_WITHIN_S)
            rooms = desk.rooms()
            _print(rooms, as_json=as_json)
            return 0 if rooms and not any(room.why_attention for room in rooms) else EXIT_ATTENTION
        if as_json:
            while not stop.wait(_LOOK_EVERY_S):
                for summary in desk.taken():
                    print(summary.model_dump_json(by_alias=True), flush=True)
            return 0
        with Live(table_of(()), console=Console(), refresh_per_second=4) as live:
            while not stop.wait(_LOOK_EVERY_S):
                desk.taken()
                live.update(table_of(desk.rooms()))
    return 0


def _print(rooms: Sequence[SeenRoom], *, as_json: bool) -> None:
    if not rooms:
        print(f"no room has shown itself within {_FIRST_WITHIN_S:g} s", file=sys.stderr)
    if not as_json:
        Console(file=sys.stdout).print(table_of(rooms))
        return
    for room in rooms:
        content = json.loads(room.summary.model_dump_json(by_alias=True))
        print(json.dumps({"age_s": round(room.age_s, 3), "attention": room.why_attention, "summary": content}))


def table_of(rooms: Iterable[SeenRoom]) -> Table:
    """One line a room."""
    table = Table("room", "robot", "stop", "case", "versions", "refused by its router", "needs somebody because")
    for room in rooms:
        shown, robot = room.summary, room.summary.robot
        versions = ", ".join(sorted({one.version for one in shown.services if one.version}))
        table.add_row(
            shown.room,
            "-" if robot is None else robot.state.value,
            "-" if robot is None else robot.stop.value,
            shown.case_id or "none",
            versions,
            str(shown.messages_denied + shown.links_refused),
            room.why_attention,
            style="bold red" if room.why_attention else "",
        )
    return table
