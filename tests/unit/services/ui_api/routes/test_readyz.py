"""`readyz` says yes only while all that it stands for does what it is there for."""

import shutil
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import event
from sqlalchemy.engine.interfaces import DBAPIConnection

from services.ui_api.front import server
from services.ui_api.handlers import readiness
from services.ui_api.record.location import sqlite_url
from shared.messages.base import encode
from shared.messages.presence import Heartbeat
from shared.messages.robot import MotionState
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, open_room

PARTS = ["bus", "imaging", "registration", "robot", "robot_state", "gateway", "frames", "access", "database", "disk"]
Checks = dict[str, dict[str, str | bool]]


def asked(room: Room) -> tuple[int, Checks]:
    answer = room.client.get("/readyz")
    return answer.status_code, {check["name"]: check for check in answer.json()["checks"]}


def wait_for(room: Room, status: int, condition: Callable[[Checks], bool] = lambda _: True) -> Checks:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        found, checks = asked(room)
        if found == status and condition(checks):
            return checks
        assert time.monotonic() < deadline_s, (found, checks)
        time.sleep(0.05)


def failed(checks: Checks) -> set[str]:
    return {name for name, check in checks.items() if not check["ok"]}


def record_of(tmp_path: Path) -> Path:
    return tmp_path / "case-record.sqlite"


def test_ready_when_all_is_there_and_each_part_says_what_was_measured(room: Room) -> None:
    checks = wait_for(room, 200)
    assert list(checks) == PARTS
    assert all(check["measured"] for check in checks.values())


def test_a_stop_in_force_is_no_lack(room: Room) -> None:
    room.robot.say(MotionState.STOPPED)
    wait_for(room, 200, lambda checks: str(checks["robot_state"]["measured"]).startswith("stopped"))


def test_what_the_front_is_short_of_is_a_lack_of_the_gateway(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    wait_for(room, 200)
    monkeypatch.setattr(server, "nearly_out_of_memory", lambda: "3 MiB are left; raise its limit")
    checks = wait_for(room, 503)
    assert failed(checks) == {"gateway"}
    assert "3 MiB" in str(checks["gateway"]["measured"])
    monkeypatch.undo()
    wait_for(room, 200)


def break_link(room: Room) -> None:
    room.router.cut()


def end_imaging(room: Room) -> None:
    room.imaging.fall_silent()


def degrade_registration(room: Room) -> None:
    room.registration.status.report("degraded", "its memory is full; restart it")


def restart_imaging(room: Room) -> None:
    room.imaging.bus.publisher(room.imaging.keys.heartbeat("imaging")).put(
        encode(Heartbeat(service="imaging", boot_epoch="another", sequence=0))
    )


def break_controller(room: Room) -> None:
    room.robot.say(MotionState.FAULT, detail="leg 3 does not answer; see to its cable")


def lose_controller(room: Room) -> None:
    room.robot.say(MotionState.DISCONNECTED, detail="no answer on /dev/ttyUSB0")


@pytest.mark.requirement("GW-08")
@pytest.mark.parametrize(
    ("broken", "part", "code", "measured"),
    [
        (break_link, "bus", "absent", "no router is connected"),
        (end_imaging, "imaging", "absent", "the service is not on the bus"),
        (degrade_registration, "registration", "degraded", "degraded: its memory is full; restart it"),
        (break_controller, "robot_state", "fault", "fault: leg 3 does not answer; see to its cable"),
        (lose_controller, "robot_state", "disconnected", "disconnected: no answer on /dev/ttyUSB0"),
    ],
)
def test_what_is_broken_is_named_with_a_remedy(
    room: Room, broken: Callable[[Room], None], part: str, code: str, measured: str
) -> None:
    broken(room)
    checks = wait_for(room, 503, lambda checks: checks[part]["code"] == code)
    assert checks[part]["measured"] == measured
    assert checks[part]["remedy"]
    document = room.client.get("/readyz").json()
    assert document["code"] == "not_ready"
    assert f"{part}: {measured}" in document["detail"]


def test_a_service_that_restarts_is_starting_until_it_reports(room: Room) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while asked(room)[1]["imaging"]["code"] != "starting":
        restart_imaging(room)
        assert time.monotonic() < deadline_s


@pytest.mark.requirement("GW-08")
def test_a_robot_that_is_silent_is_stale(tmp_path: Path) -> None:
    with open_room(tmp_path, robot_state_stale_after_s=0.001) as room:
        checks = wait_for(room, 503, lambda checks: checks["robot_state"]["code"] == "stale")
        assert "(limit 0.001 s)" in str(checks["robot_state"]["measured"])


def test_a_disk_that_is_nearly_full_is_not_ready(tmp_path: Path) -> None:
    with open_room(tmp_path, least_free_mib=1e12) as room:
        checks = wait_for(room, 503, lambda checks: failed(checks) <= {"disk", "gateway"})
        assert "(limit 1e+12 MiB)" in str(checks["disk"]["measured"])


def test_a_records_own_disk_that_is_nearly_full_is_not_ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record, full = tmp_path / "record", "the disk has 0 MiB free"
    record.mkdir()
    monkeypatch.setattr(readiness, "nearly_full", lambda folder, _: full if folder == record else None)
    with open_room(tmp_path, database_url=sqlite_url(record)) as room:
        checks = wait_for(room, 503, lambda checks: failed(checks) == {"disk"})
        assert checks["disk"]["measured"] == full


def test_a_disk_that_fills_is_not_ready(tmp_path: Path) -> None:
    with open_room(tmp_path, announce_free_percent=100.0, announce_free_mib=1e12) as room:
        checks = wait_for(room, 503, lambda checks: failed(checks) <= {"disk", "gateway"})
        assert checks["disk"]["code"] == "filling"


def test_a_locked_record_is_not_ready_and_ready_again_when_it_is_free(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        wait_for(room, 200)
        holder = sqlite3.connect(record_of(tmp_path), isolation_level=None)
        holder.execute("BEGIN IMMEDIATE")
        checks = wait_for(room, 503)
        assert failed(checks) == {"database"}
        assert "database is locked" in str(checks["database"]["measured"])
        holder.execute("ROLLBACK")
        holder.close()
        wait_for(room, 200)


def test_a_record_that_takes_nothing_is_not_ready(tmp_path: Path) -> None:
    def refuse_writing(connection: DBAPIConnection, _: object) -> None:
        connection.cursor().execute("PRAGMA query_only=ON")

    with open_room(tmp_path) as room:
        wait_for(room, 200)
        event.listen(room.gateway.record._fresh, "connect", refuse_writing)
        checks = wait_for(room, 503)
        assert failed(checks) == {"database"}
        assert "attempt to write a readonly database" in str(checks["database"]["measured"])
        event.remove(room.gateway.record._fresh, "connect", refuse_writing)
        wait_for(room, 200)


def test_a_record_whose_file_was_replaced_is_not_ready(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        wait_for(room, 200)
        shutil.copy(record_of(tmp_path), tmp_path / "copy")
        (tmp_path / "copy").replace(record_of(tmp_path))
        checks = wait_for(room, 503)
        assert failed(checks) == {"database"}


def test_a_record_that_is_corrupt_is_not_ready(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        wait_for(room, 200)
        for file in (record_of(tmp_path), Path(f"{record_of(tmp_path)}-wal")):
            file.write_bytes(b"\x5a" * file.stat().st_size)
        checks = wait_for(room, 503)
        assert failed(checks) == {"database"}


def test_probing_adds_nothing_to_the_log(room: Room) -> None:
    wait_for(room, 200)
    before = room.gateway.record.ledger.head_sequence
    room.gateway.record.require_writable()
    assert room.gateway.record.ledger.head_sequence == before
    assert len(room.gateway.record.events_after(before)) == 0


def test_one_probe_serves_all_who_ask_at_once(room: Room) -> None:
    probes = {id(room.gateway.readiness.probe()) for _ in range(50)}
    assert len(probes) <= 2
