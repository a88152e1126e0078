"""Figures for Prometheus: what they count, and that alert rules and dashboard name only figures that are there."""

import re

import pytest

from shared.errors import ReasonCode
from tests.unit.services.ui_api.room import Room, wait_until
from tools.monitoring import ALERTS, PANELS

_NAMES = re.compile(r"distalock_\w+")


def figure(room: Room, name: str) -> float:
    """A figure by its name and labels, as /metrics prints it; NaN when it is not there."""
    lines = (line.rpartition(" ") for line in room.client.get("/metrics").text.splitlines())
    return next((float(value) for key, _, value in lines if key == name), float("nan"))


def test_images_and_refusals_are_counted_by_reason(room: Room) -> None:
    room.image("one", case_id := room.open_case(), ReasonCode.NAIL_NOT_FOUND)
    room.image("two", case_id)
    room.registration.refusal = ("out_of_reach", "leg 3 would be 54.2 mm long (limit 53.0 mm); move the mount")
    room.post(f"/cases/{case_id}/plans", {"localisation": 2, "hole_ids": ["distal"]})
    assert figure(room, 'distalock_images_total{by="shot"}') == 2.0
    assert figure(room, 'distalock_refusals_total{code="nail_not_found",of="localisation"}') == 1.0
    assert figure(room, 'distalock_refusals_total{code="out_of_reach",of="plan"}') == 1.0


def test_stops_are_timed_by_whether_they_were_confirmed(room: Room) -> None:
    assert figure(room, 'distalock_stop_seconds_count{confirmed="yes"}') == 0.0
    room.client.post("/api/v1/robot/stop")
    wait_until(lambda: figure(room, 'distalock_stop_seconds_count{confirmed="yes"}') == 1.0)
    assert 0.0 < figure(room, 'distalock_stop_seconds_sum{confirmed="yes"}') < 60.0
    assert figure(room, 'distalock_stop_seconds_count{confirmed="no"}') == 0.0


def test_methods_that_somebody_makes_up_make_no_labels(room: Room) -> None:
    for method in ("BREW", "WHEN"):
        room.client.request(method, "/api/v1/robot")
    assert figure(room, 'distalock_http_requests_total{method="other",route="/api/v1/robot",status="405"}') == 2.0
    assert "BREW" not in room.client.get("/metrics").text


def test_writes_to_the_record_are_timed(room: Room) -> None:
    before = figure(room, "distalock_record_write_seconds_count")
    room.open_case()
    assert figure(room, "distalock_record_write_seconds_count") > before
    assert figure(room, "distalock_record_write_seconds_sum") > 0.0


def test_what_is_read_when_asked_for_is_there(room: Room) -> None:
    assert figure(room, 'distalock_leases{state="held"}') == 0.0
    assert figure(room, 'distalock_leases{state="lapsed"}') == 0.0
    assert figure(room, 'distalock_queue_refused{queue="inbox"}') == 0.0
    wait_until(lambda: figure(room, 'distalock_heartbeat_age_seconds{service="robot"}') < 60.0)


EXPRESSIONS = {
    **{f"alert {alert.name}": alert.expression for alert in ALERTS},
    **{f"{panel.title}: {legend}": text for panel in PANELS for legend, text in panel.curves.items()},
}


@pytest.fixture(scope="module")
def names(quiet_room: Room) -> set[str]:
    """Names of everything that a running gateway answers, with what has not happened yet."""
    return set(re.findall(r"^(?:# TYPE )?(distalock_\w+)", quiet_room.client.get("/metrics").text, re.MULTILINE))


def test_rules_and_panels_name_only_what_is_there(names: set[str]) -> None:
    derived = names | {f"{name}_bucket" for name in names} | {f"{name}_count" for name in names}
    strange = {what: set(_NAMES.findall(text)) - derived for what, text in EXPRESSIONS.items()}
    assert not any(strange.values()), strange


def test_every_figure_is_on_the_dashboard(names: set[str]) -> None:
    shown = {name for panel in PANELS for text in panel.curves.values() for name in _NAMES.findall(text)}
    families = {re.sub(r"_(bucket|count|sum|created|total)$", "", name) for name in names}
    assert families == {re.sub(r"_(bucket|count|sum|created|total)$", "", name) for name in shown}
