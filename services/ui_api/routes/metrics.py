"""What the gateway measures about itself, in base units."""

import time

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.ui_api.link_messages import FrontFigures
from services.ui_api.service import Gateway
from shared.runtime.logging import dropped_lines

_STOP_ROUTE = "/api/v1/robot/stop"


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
        self._alive = Gauge(
            "distalock_service_alive", "Whether a service is on the bus.", ("service",), registry=self.registry
        )

    def note_stop(self, *, confirmed: bool, took_s: float) -> None:
        """Count a stop, which the front has answered: the requests of this process do not show it."""
        self.requests.labels("POST", _STOP_ROUTE, "200" if confirmed else "504").inc()
        self.seconds.labels(_STOP_ROUTE).observe(took_s)

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
        for service, alive in gateway.inbox.presence.alive.items():
            self._alive.labels(service).set(float(alive))


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
