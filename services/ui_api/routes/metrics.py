"""What the gateway measures about itself and the room, in base units; docs/monitoring.md lists all of it."""

import time
from collections.abc import Sequence
from typing import Final

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.ui_api.core.event_data import (
    ImageReceived,
    ImageSkipped,
    LocalisationReceived,
    PlanRefused,
    VerificationRefused,
)
from services.ui_api.core.events import Event
from services.ui_api.link_messages import FrontFigures
from services.ui_api.service import Gateway
from shared.runtime.logging import dropped_lines

_STOP_ROUTE = "/api/v1/robot/stop"
# Chosen: from the usual confirmation to the time after which a stop counts as not confirmed, in steps of 2 to 2.5.
_STOP_BUCKETS_S: Final = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
# Chosen: from a commit on a fast disk to the time for which a writer waits for a lock.
_WRITE_BUCKETS_S: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


class Metrics:
    """Metrics of one application, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "distalock_http_requests", "Answered requests.", ("method", "route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "distalock_http_request_duration_seconds", "Time to the first byte.", ("route",), registry=self.registry
        )
        self._events = Gauge("distalock_log_events", "Events in the log.", registry=self.registry)
        self._robot_age = Gauge(
            "distalock_robot_state_age_seconds",
            "Age of the newest robot state; NaN before the first.",
            registry=self.registry,
        )
        self._pending = Gauge("distalock_operations_pending", "Operations not ended.", registry=self.registry)
        self._dropped_lines = Gauge(
            "distalock_log_lines_dropped", "Log lines that could not be written.", registry=self.registry
        )
        self.front = FrontFigures(connections=0, relays=0, streams=0, stops=0, closed_idle=0, refused=0)
        self._front = Gauge(
            "distalock_front",
            "The process that owns the port, a second ago at most: open connections, requests that the application "
            "works on, streams handed to it, stops not on record yet; since its start: connections closed to make "
            "room, requests refused.",
            ("figure",),
            registry=self.registry,
        )
        self._refused = Gauge(
            "distalock_bus_refusals",
            "What the router has refused since its start; NaN before it has reported.",
            ("code",),
            registry=self.registry,
        )
        self._queued = Gauge(
            "distalock_queued", "What waits in a queue of the gateway.", ("queue",), registry=self.registry
        )
        self._not_queued = Gauge(
            "distalock_queue_refused",
            "What a full queue of the gateway has refused since its start; images are asked for again.",
            ("queue",),
            registry=self.registry,
        )
        self._alive = Gauge(
            "distalock_service_alive", "Whether a service is on the bus.", ("service",), registry=self.registry
        )
        self._heartbeat_age = Gauge(
            "distalock_heartbeat_age_seconds",
            "Time since a service's last heartbeat; infinite before the first.",
            ("service",),
            registry=self.registry,
        )
        self._leases = Gauge(
            "distalock_leases",
            "Hold-to-move leases: held now; lapsed since the gateway's start, each of which stopped the robot.",
            ("state",),
            registry=self.registry,
        )
        self._images = Counter(
            "distalock_images",
            "X-ray images on record, by how they came: shot or run.",
            ("by",),
            registry=self.registry,
        )
        self._refusals = Counter(
            "distalock_refusals",
            "What was refused, by what it was (image, localisation, plan, verification) and reason.",
            ("of", "code"),
            registry=self.registry,
        )
        self._stops = Histogram(
            "distalock_stop_seconds",
            "From a stop's request over REST to the end of its way: standstill confirmed, or given up.",
            ("confirmed",),
            buckets=_STOP_BUCKETS_S,
            registry=self.registry,
        )
        self.write_seconds = Histogram(
            "distalock_record_write_seconds",
            "Time of a transaction that wrote to the case record, with its wait for others.",
            buckets=_WRITE_BUCKETS_S,
            registry=self.registry,
        )
        for by in ("shot", "run"):
            self._images.labels(by)
        for confirmed in ("yes", "no"):
            self._stops.labels(confirmed)

    def note_stop(self, *, confirmed: bool, took_s: float) -> None:
        """Count a stop, which the front has answered: the requests of this process do not show it."""
        self.requests.labels("POST", _STOP_ROUTE, "200" if confirmed else "504").inc()
        self.seconds.labels(_STOP_ROUTE).observe(took_s)
        self._stops.labels("yes" if confirmed else "no").observe(took_s)

    def note_events(self, events: Sequence[Event]) -> None:
        """Count what has come on record."""
        for event in events:
            match event.data:
                case ImageReceived(in_run=in_run):
                    self._images.labels("run" if in_run else "shot").inc()
                case LocalisationReceived(reason_codes=codes):
                    for code in codes:
                        self._refusals.labels("localisation", code).inc()
                case PlanRefused(code=code):
                    self._refusals.labels("plan", code).inc()
                case VerificationRefused(code=code):
                    self._refusals.labels("verification", code).inc()
                case ImageSkipped(code=code):
                    self._refusals.labels("image", code).inc()
                case _:
                    pass

    def observe(self, gateway: Gateway) -> None:
        """Read what is not counted as it happens."""
        age_s = gateway.view.age_s()
        self._events.set(gateway.record.ledger.head_sequence)
        self._robot_age.set(float("nan") if age_s is None else age_s)
        self._pending.set(len(gateway.record.ledger.pending_operations()))
        self._dropped_lines.set(dropped_lines()[0])
        for figure, value in self.front.model_dump(exclude={"kind", "lacking"}).items():
            self._front.labels(figure).set(value)
        for code, refused in gateway.refusals.figures().items():
            self._refused.labels(code).set(refused)
        self._queued.labels("inbox").set(gateway.inbox.waiting)
        self._queued.labels("stop_record").set(len(gateway.stop_recorder))
        self._not_queued.labels("inbox").set(gateway.inbox.refused)
        self._leases.labels("held").set(gateway.leases.held)
        self._leases.labels("lapsed").set(gateway.leases.lapsed)
        for service, alive in gateway.inbox.presence.alive.items():
            self._alive.labels(service).set(float(alive))
            self._heartbeat_age.labels(service).set(gateway.services.silent_for_s(service))


class MeasuringMiddleware:
    """Counts requests by their route, not by their path, so that ids do not become labels."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, and note when the answer begins."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began_s = time.monotonic()

        async def noting(message: Message) -> None:
            if message["type"] == "http.response.start":
                route = getattr(scope.get("route"), "path", "unknown")
                self._metrics.requests.labels(scope["method"], route, str(message["status"])).inc()
                self._metrics.seconds.labels(route).observe(time.monotonic() - began_s)
            await send(message)

        await self._app(scope, receive, noting)
