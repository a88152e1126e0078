"""What watches an installation: `docs/monitoring.md`, alert rules for Prometheus and a dashboard for Grafana.

Rules and panels are tables here, so that a metric that is renamed is noticed in one place.
"""

import json
from dataclasses import dataclass
from typing import Final

from prometheus_client.metrics_core import Metric

from services.ui_api.routes.metrics import Metrics


@dataclass(frozen=True, slots=True)
class Alert:
    """A condition that a person must see to: how long it must last, what it means, what to do."""

    name: str
    expression: str
    lasts: str
    severity: str
    summary: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Panel:
    """A chart: its curves by legend, and the unit as Grafana names it."""

    title: str
    unit: str
    curves: dict[str, str]


ALERTS: Final = (
    Alert(
        "GatewayGone",
        'up{job="distalock"} == 0',
        "5s",
        "critical",
        "Nobody answers at the gateway's port.",
        "See whether the gateway runs (`distalock doctor`); the robot is stopped without it.",
    ),
    Alert(
        "ServiceGone",
        "distalock_service_alive == 0",
        "5s",
        "critical",
        "{{ $labels.service }} is not on the bus.",
        "See to its log; it is started again by `distalock up` or its container.",
    ),
    Alert(
        "HeartbeatLate",
        "distalock_heartbeat_age_seconds > 2",
        "5s",
        "critical",
        "{{ $labels.service }} has been silent for {{ $value | humanizeDuration }}.",
        "It hangs or its link is cut: see to its log, and start it again.",
    ),
    Alert(
        "RobotStateStale",
        "distalock_robot_state_age_seconds > 1",
        "5s",
        "critical",
        "The robot's state is {{ $value | humanizeDuration }} old.",
        "See to the robot service, and to the line to its controller.",
    ),
    Alert(
        "StopNotConfirmed",
        'increase(distalock_stop_seconds_count{confirmed="no"}[10m]) > 0',
        "0s",
        "critical",
        "A stop was not confirmed: the controller did not show that the robot stands still.",
        "Look at the robot; switch its controller off if it moves.",
    ),
    Alert(
        "StopSlow",
        "histogram_quantile(0.99, rate(distalock_stop_seconds_bucket[30m])) > 0.2",
        "0s",
        "warning",
        "1 % of stops take longer than {{ $value | humanizeDuration }} until standstill is confirmed.",
        "See what else computes on this machine, and whether real-time scheduling is allowed (docs/safety.md).",
    ),
    Alert(
        "LeaseLapsed",
        'increase(distalock_leases{state="lapsed"}[10m]) > 0',
        "0s",
        "warning",
        "A motion ended because nobody held it any more.",
        "See to the console and its network: the page was closed, or the link is slow.",
    ),
    Alert(
        "RecordSlow",
        "histogram_quantile(0.99, rate(distalock_record_write_seconds_bucket[5m])) > 0.5",
        "1m",
        "warning",
        "1 % of writes to the case record take longer than {{ $value | humanizeDuration }}.",
        "See to its disk, and to who else holds the database.",
    ),
    Alert(
        "StopsNotOnRecord",
        'distalock_queued{queue="stop_record"} > 0',
        "30s",
        "warning",
        "{{ $value }} stops wait to be recorded.",
        "The case record cannot be written: `distalock doctor` says why.",
    ),
    Alert(
        "QueueFull",
        "increase(distalock_queue_refused[10m]) > 0",
        "0s",
        "warning",
        "The queue {{ $labels.queue }} was full.",
        "The record is too slow for what comes in; nothing is lost.",
    ),
    Alert(
        "ForgedMessages",
        "increase(distalock_bus_refusals[10m]) > 0",
        "0s",
        "warning",
        "The router refused what a client may not do: {{ $labels.code }}.",
        "Somebody tries what no service does: see the event `bus_refused` for who.",
    ),
    Alert(
        "FramesByTcp",
        'increase(distalock_frames{path="tcp"}[10m]) > 2',
        "0s",
        "warning",
        "Frames come by TCP in place of shared memory.",
        "See `no shared memory` in the logs of imaging and the gateway: the limit of locked memory, or /dev/shm.",
    ),
    Alert(
        "LogLinesLost",
        "increase(distalock_log_lines_dropped[10m]) > 0",
        "0s",
        "warning",
        "Log lines could not be written.",
        "The disk is full, or who reads the log has gone.",
    ),
)

PANELS: Final = (
    Panel("Services on the bus", "short", {"{{service}}": "distalock_service_alive"}),
    Panel("Age of heartbeats", "s", {"{{service}}": "distalock_heartbeat_age_seconds"}),
    Panel("Age of the robot's state", "s", {"robot": "distalock_robot_state_age_seconds"}),
    Panel(
        "Stops, time to their end",
        "s",
        {
            "median": "histogram_quantile(0.5, sum by (le) (rate(distalock_stop_seconds_bucket[30m])))",
            "99 %": "histogram_quantile(0.99, sum by (le) (rate(distalock_stop_seconds_bucket[30m])))",
        },
    ),
    Panel("Stops", "short", {"confirmed: {{confirmed}}": "increase(distalock_stop_seconds_count[1h])"}),
    Panel("X-ray images per hour", "short", {"{{by}}": "increase(distalock_images_total[1h])"}),
    Panel("Refusals per hour", "short", {"{{of}}: {{code}}": "increase(distalock_refusals_total[1h]) > 0"}),
    Panel("Leases", "short", {"{{state}}": "distalock_leases"}),
    Panel("Frames per minute", "short", {"{{path}}": "increase(distalock_frames[1m])"}),
    Panel(
        "Writes to the case record",
        "s",
        {
            "median": "histogram_quantile(0.5, sum by (le) (rate(distalock_record_write_seconds_bucket[5m])))",
            "99 %": "histogram_quantile(0.99, sum by (le) (rate(distalock_record_write_seconds_bucket[5m])))",
        },
    ),
    Panel(
        "Waiting",
        "short",
        {
            "{{queue}}": "distalock_queued",
            "operations": "distalock_operations_pending",
            "{{queue}}, refused": "distalock_queue_refused",
        },
    ),
    Panel("Requests per second", "reqps", {"{{status}}": "sum by (status) (rate(distalock_http_requests_total[1m]))"}),
    Panel(
        "Time to the first byte, 99 %",
        "s",
        {
            "{{route}}": "histogram_quantile(0.99, sum by (le, route) "
            "(rate(distalock_http_request_duration_seconds_bucket[5m])))",
        },
    ),
    Panel("Refused as too many, since the start", "short", {"by {{by}}": "distalock_rate_limited"}),
    Panel("The process that owns the port", "short", {"{{figure}}": "distalock_front"}),
    Panel("Refused by the router", "short", {"{{code}}": "distalock_bus_refusals"}),
    Panel("Events on record", "short", {"events": "distalock_log_events"}),
    Panel("Log lines lost", "short", {"gateway": "distalock_log_lines_dropped"}),
)

_HEAD: Final = """# Monitoring: figures, alerts and a dashboard for a running installation

`GET /metrics` of the gateway answers in Prometheus' format. From the room's own networks it needs no login. Give
Prometheus [`deploy/monitoring/prometheus.yml`](../deploy/monitoring/prometheus.yml), which names the gateway's address
and the alert rules beside it, and import [`dashboard.json`](../deploy/monitoring/dashboard.json) into Grafana:

```console
$ prometheus --config.file=deploy/monitoring/prometheus.yml
```

Nothing of a procedure depends on it, and it can command nothing. This page, the rules and the dashboard are printed
from `tools/monitoring.py` and the gateway's registry. What is wrong right now, with remedies, `distalock doctor` and
`GET /readyz` say ([rest.md](rest.md)).
"""
_TRACES: Final = """
## Following a request through the logs

Log lines are JSON. A request is a trace after W3C's recommendation: the caller's own where it sends `traceparent`, or a
new one; the answer's header `traceresponse` names it. Lines that are written while somebody works for the request have
its `trace_id`, and `case` where its path names one, in the gateway and, over the bus, in imaging, registration and the
robot service. The robot's line `command accepted` has the trace and the command's id, by which the lines of its states
follow; they go on after the answer.

```console
$ grep -h 0af7651916cd43dd8448eb211c80319c STATE/logs/*.jsonl*
```
"""
_COLUMNS: Final = 2
_WIDTH, _HEIGHT = 24 // _COLUMNS, 8


def metrics() -> list[Metric]:
    """Everything that the gateway measures, in the order of its declaration."""
    return list(Metrics().registry.collect())


def monitoring_page() -> str:
    """The page as it must be."""
    figures = "".join(f"| `{one.name}` | {one.type} | {one.documentation} |\n" for one in metrics())
    alerts = "".join(
        f"| `{a.name}` | {a.severity} | `{a.expression.replace('|', chr(92) + '|')}` for {a.lasts} | {a.remedy} |\n"
        for a in ALERTS
    )
    return (
        f"{_HEAD}\n## Figures\n\nCounters end in `_total`, histograms have `_bucket`, `_sum` and `_count`. All count "
        f"from the gateway's start.\n\n| name | kind | meaning |\n|---|---|---|\n{figures}\n## Alerts\n\n"
        f"| alert | severity | when | what to do |\n|---|---|---|---|\n{alerts}{_TRACES}"
    )


def alert_rules() -> str:
    """`alerts.json` for Prometheus, which reads YAML: JSON is a part of it."""
    rules = [
        {
            "alert": alert.name,
            "expr": alert.expression,
            "for": alert.lasts,
            "labels": {"severity": alert.severity},
            "annotations": {"summary": alert.summary, "remedy": alert.remedy},
        }
        for alert in ALERTS
    ]
    return _json({"groups": [{"name": "distalock", "rules": rules}]})


def dashboard() -> str:
    """`dashboard.json` for Grafana."""
    panels = [
        {
            "id": number + 1,
            "type": "timeseries",
            "title": panel.title,
            "datasource": {"type": "prometheus", "uid": "${source}"},
            "gridPos": {
                "x": _WIDTH * (number % _COLUMNS),
                "y": _HEIGHT * (number // _COLUMNS),
                "w": _WIDTH,
                "h": _HEIGHT,
            },
            "fieldConfig": {"defaults": {"unit": panel.unit}, "overrides": []},
            "targets": [
                {"refId": chr(ord("A") + curve), "expr": expression, "legendFormat": legend}
                for curve, (legend, expression) in enumerate(panel.curves.items())
            ],
        }
        for number, panel in enumerate(PANELS)
    ]
    source = {"name": "source", "type": "datasource", "query": "prometheus", "label": "Prometheus"}
    content = {
        "uid": "distalock",
        "title": "distalock",
        "schemaVersion": 39,
        "refresh": "5s",
        "time": {"from": "now-1h", "to": "now"},
        "templating": {"list": [source]},
        "panels": panels,
    }
    return _json(content)


def _json(content: dict[str, object]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
