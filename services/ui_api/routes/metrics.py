"""What the gateway measures about itself and the room, in base units; docs/monitoring.md lists all of it."""

import time
from collections.abc import Sequence
from functools import cache
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
_METHODS: Final = frozenset(("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT"))
_OTHER: Final = "other"
# Chosen: from the usual confirmation to the time after which a stop counts as not confirmed, in steps of 2 to 2.5.
_STOP_BUCKETS_S: Final = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
# Chosen: from a commit on a fast disk to the time for which a writer waits for a lock.
_WRITE_BUCKETS_S: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


class Metrics:
    """Metrics of one application, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.front = FrontFigures(connections=0, relays=0, streams=0, stops=0, closed_idle=0, refused=0)
        self._counted_here()
        self._read_off_the_gateway()

    def _counted_here(self) -> None:
        """What is counted as it happens."""
        self.requests = Counter(
            "distalock_http_requests", "Answered requests.", ("method", "route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "distalock_http_request_duration_seconds", "Time to the first byte.", ("route",), registry=self.registry
        )
        self._count_of, self._time_of = cache(self.requests.labels), cache(self.seconds.labels)
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

    def _read_off_the_gateway(self) -> None:
        """What `observe` reads when somebody asks."""
        self._events = self._gauge("log_events", "Events in the log.")
        self._robot_age = self._gauge("robot_state_age_seconds", "Age of the newest robot state; NaN before the first.")
        self._pending = self._gauge("operations_pending", "Operations not ended.")
        self._dropped_lines = self._gauge("log_lines_dropped", "Log lines that could not be written.")
        self._front = self._gauge(
            "front",
            "The process that owns the port, a second ago at most: open connections, requests that the application "
            "works on, streams handed to it, stops not on record yet; since its start: connections closed to make "
            "room, requests refused.",
            "figure",
        )
        self._refused = self._gauge(
            "bus_refusals", "What the router has refused since its start; NaN before it has reported.", "code"
        )
        self._queued = self._gauge("queued", "What waits in a queue of the gateway.", "queue")
        self._not_queued = self._gauge(
            "queue_refused",
            "What a full queue of the gateway has refused since its start; images are asked for again.",
            "queue",
        )
        self._alive = self._gauge("service_alive", "Whether a service is on the bus.", "service")
        self._heartbeat_age = self._gauge(
            "heartbeat_age_seconds", "Time since a service's last heartbeat; infinite before the first.", "service"
        )
        self._frames = self._gauge(
            "frames",
            "Frames that the gateway has received since its start, by how: shared_memory, or tcp, which is the slower "
            "way where no memory can be shared.",
            "path",
        )
        self._rate_limited = self._gauge(
            "rate_limited",
            "Requests refused since the start: too many of one token, or of one address.",
            "by",
        )
        self._leases = self._gauge(
            "leases",
            "Hold-to-move leases: held now; lapsed since the gateway's start, each of which stopped the robot.",
            "state",
        )

    def _gauge(self, name: str, meaning: str, *labels: str) -> Gauge:
        return Gauge(f"distalock_{name}", meaning, labels, registry=self.registry)

    def note_request(self, method: str, route: str, status: int, took_s: float) -> None:
        """Count a request that is answered; a method that HTTP does not know makes no label of its own."""
        self._count_of(method if method in _METHODS else _OTHER, route, str(status)).inc()
        self._time_of(route).observe(took_s)

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
        self._frames.labels("shared_memory").set(gateway.live.paths.by_shared_memory)
        self._frames.labels("tcp").set(gateway.live.paths.by_tcp)
        for by, refused in gateway.access.rate_limits.refused.items():
            self._rate_limited.labels(by).set(refused)
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
                self._metrics.note_request(scope["method"], route, message["status"], time.monotonic() - began_s)
            await send(message)

        await self._app(scope, receive, noting)
