"""Whether all is there that a procedure needs: each part asked for what it is there for, with the remedy.

A stop that is in force is no lack: every start begins with it.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock
from typing import Final

from services.ui_api.handlers.bus_refusals import BusRefusalLog, summary
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.inbox import Inbox
from services.ui_api.handlers.robot_view import RobotView, Validity
from services.ui_api.handlers.service_health import SILENT_AFTER_S, ServiceHealth
from services.ui_api.record.record import CaseRecord
from shared.bus.frame_paths import FramePaths
from shared.errors import RecordUnavailable
from shared.messages.presence import ServiceName
from shared.messages.robot import MotionState
from shared.runtime.impairments import filling, nearly_full
from shared.runtime.presence import StatusReporter
from shared.runtime.settings import ServiceSettings
from shared.threads import described

# Chosen: many who ask cost one probe; still far below what a person or a container's health check notices.
PROBE_LASTS_S: Final = 0.5
PROBE_WITHIN_S: Final = 2.0
_NOT_READY: Final = frozenset({MotionState.FAULT, MotionState.DISCONNECTED})


@dataclass(frozen=True, slots=True)
class Check:
    """One part of what a procedure needs.

    Attributes
    ----------
    code
        ``ok``, or what is wrong in a word: ``absent``, ``silent``, ``starting``, ``degraded``, ``stale``, ``fault``,
        ``disconnected``, ``unavailable``, ``full``, ``filling``.
    remedy
        What to do; empty when the part is well. A part that does what it is there for may have one too.
    """

    name: str
    code: str
    measured: str
    remedy: str = ""

    @property
    def ok(self) -> bool:
        """Whether the part does what it is there for."""
        return self.code == "ok"


@dataclass(frozen=True, slots=True)
class ReadinessParts:
    """What is asked."""

    record: CaseRecord
    view: RobotView
    inbox: Inbox
    services: ServiceHealth
    refusals: BusRefusalLog
    own_status: StatusReporter
    link_up: Callable[[], bool]
    settings: ServiceSettings
    clock: Clock
    frames: FramePaths


class Readiness:
    """Asks all parts. Disk and database are asked on a thread of their own, one probe at a time, twice a second."""

    def __init__(self, parts: ReadinessParts) -> None:
        self._parts = parts
        self._prober = ThreadPoolExecutor(max_workers=1, thread_name_prefix="readiness")
        self._lock = Lock()
        self._probe: Future[tuple[Check, ...]] | None = None
        self._probed_at_s = float("-inf")

    def close(self) -> None:
        """Probe no more; a probe that hangs is not waited for."""
        self._prober.shutdown(wait=False, cancel_futures=True)

    def probe(self) -> "Future[tuple[Check, ...]]":
        """The probe of disk and database that is under way or was made a moment ago, or a new one; never waits."""
        with self._lock:
            now_s = self._parts.clock.monotonic_s()
            if self._probe is None or (self._probe.done() and now_s - self._probed_at_s > PROBE_LASTS_S):
                self._probe, self._probed_at_s = self._prober.submit(self._asked), now_s
            return self._probe

    def checks(self, probe: "Future[tuple[Check, ...]]") -> tuple[Check, ...]:
        """All parts, with what a probe found; one that has not ended counts as a database that takes nothing."""
        stored = probe.result() if probe.done() else (_hanging(),)
        return (*self._live(), *stored)

    def _live(self) -> Iterator[Check]:
        parts = self._parts
        if parts.link_up():
            yield Check("bus", "ok", "a router is connected")
        else:
            yield Check("bus", "absent", "no router is connected", "start the router, see to the network")
        yield from (self._service(service) for service in parts.services.heard)
        yield self._robot_state()
        yield self._gateway()
        yield _frames(parts.frames)
        # Never a lack: whoever is refused could keep the system from being used.
        yield Check("access", "ok", summary(parts.refusals.newest))

    def _service(self, service: ServiceName) -> Check:
        heard, silent_s = self._parts.services.heard[service], self._parts.services.silent_for_s(service)
        restart = f"start the {service} service, or see why it ended in its log"
        if not self._parts.inbox.presence.alive[service]:
            return Check(service, "absent", "the service is not on the bus", restart)
        if silent_s > SILENT_AFTER_S:
            ever = "it has sent none" if silent_s == float("inf") else f"the last one was {silent_s:.1f} s ago"
            return Check(service, "silent", f"no heartbeat for {SILENT_AFTER_S:g} s: {ever}", f"re{restart}")
        status = heard.status
        if status is None or status.boot_epoch != heard.boot_epoch:
            return Check(service, "starting", "the service has not reported its condition", "wait; then restart it")
        if status.condition != "ready":
            code = "degraded" if status.condition == "degraded" else "starting"
            return Check(service, code, f"{status.condition}: {status.detail}".rstrip(": "), "see the detail")
        return Check(service, "ok", status.detail or "ready")

    def _robot_state(self) -> Check:
        view, age_s = self._parts.view, self._parts.view.age_s()
        seen, validity = view.newest(), view.validity()
        if seen is None or age_s is None:
            return Check("robot_state", "absent", "the robot has not reported its state", "see to its service")
        if validity is not Validity.CURRENT:
            return Check(
                "robot_state",
                "stale",
                f"the newest state is {age_s:.1f} s old (limit {view.stale_after_s:g} s)",
                "see to the robot service and to the link",
            )
        state, detail = seen.state.state, seen.state.detail
        if state in _NOT_READY:
            return Check("robot_state", state.value, f"{state}: {detail}", "see the detail; then reset")
        return Check("robot_state", "ok", f"{state}, {age_s:.1f} s old")

    def _gateway(self) -> Check:
        if (blocked := self._parts.inbox.blocked) is not None:
            return Check("gateway", "unavailable", f"what comes in waits to be recorded: {blocked}", "see 'database'")
        if impaired := self._parts.own_status.impaired:
            return Check("gateway", "degraded", "; ".join(impaired), "see the detail")
        return Check("gateway", "ok", "records what comes in")

    def _asked(self) -> tuple[Check, ...]:
        return (self._database(), self._disk())

    def _database(self) -> Check:
        try:
            self._parts.record.require_writable()
        except RecordUnavailable as error:
            return Check("database", "unavailable", str(error), "see to the disk of the state folder, or restore")
        except Exception as error:  # noqa: BLE001 - whatever a database driver raises is the finding
            return Check("database", "unavailable", described(error), "see the gateway's log")
        return Check("database", "ok", "a row was written and the newest event read")

    def _disk(self) -> Check:
        settings, folder = self._parts.settings, self._parts.settings.state_dir
        # A record on a full disk of its own takes some more rows, in place of old ones, before it refuses the first.
        for place in (folder, self._parts.record.folder):
            if place is not None and (sentence := nearly_full(place, settings.least_free_mib)) is not None:
                return Check("disk", "full", sentence, "free some space, or move the folder to a larger disk")
        if (sentence := filling(folder, settings.announce_free_percent, settings.announce_free_mib)) is not None:
            return Check("disk", "filling", sentence, "no new case is opened until there is more space")
        return Check("disk", "ok", f"{settings.announce_free_percent:g} % or {settings.announce_free_mib:g} MiB free")


def _frames(paths: FramePaths) -> Check:
    """Never a lack: by TCP they are slower, and as good."""
    remedy = "see `no shared memory` in the logs of imaging and the gateway" if paths.fallen_back else ""
    return Check("frames", "ok", paths.sentence, remedy)


def _hanging() -> Check:
    measured = f"the database or its disk did not answer within {PROBE_WITHIN_S:g} s"
    return Check("database", "unavailable", measured, "see to the disk of the state folder")
