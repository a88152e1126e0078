"""Accounts over REST: the first one by its link, all others by an administrator; approval with the password again."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.ui_api.core.access_settings import SETUP_FILE
from services.ui_api.core.event_data import CaseOpened, PlanApproved
from services.ui_api.core.events import EventData
from services.ui_api.core.robot_event_data import OperationRequested
from services.ui_api.core.roles import Role
from services.ui_api.handlers.refusals import Refused
from shared.messages.base import decode
from shared.messages.permits import Permit
from shared.messages.robot import MotionState
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.people import PASSWORD, add_account, signed_in
from tests.unit.services.ui_api.room import Room, new_key, open_room

USERS = "/api/v1/users"


def _outcome(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


@pytest.fixture
def hospital(tmp_path: Path) -> Iterator[Room]:
    """A gateway beside a real controller: without the simulation's user."""
    with open_room(tmp_path, demo_token_file=None) as opened:
        yield opened


def _who(room: Room, kind: type[EventData]) -> list[str]:
    return [event.who for event in room.gateway.record.events_after(0) if isinstance(event.data, kind)]


def test_the_first_account_is_made_by_a_link_that_works_once(hospital: Room, tmp_path: Path) -> None:
    link = (tmp_path / SETUP_FILE).read_text().strip()
    assert (tmp_path / SETUP_FILE).stat().st_mode & 0o077 == 0
    url, page = (
        str(hospital.client.base_url).rstrip("/"),
        httpx.get(f"{hospital.client.base_url}{link}", timeout=PATIENCE_S),
    )
    assert "<form method='post'" in page.text
    assert "script" not in page.text
    form = {"name": "root.of.all", "password": "short"}
    assert "the password has 5 characters" in httpx.post(url + link, data=form, timeout=PATIENCE_S).text
    assert _outcome(httpx.post(f"{url}/api/v1/setup?token=guessed", data=form, timeout=PATIENCE_S)) == (
        403,
        "setup_link_invalid",
    )
    made = httpx.post(url + link, data=form | {"password": PASSWORD}, timeout=PATIENCE_S)
    assert made.status_code == 200, made.text
    assert not (tmp_path / SETUP_FILE).exists()
    again = httpx.post(url + link, data={"name": "another", "password": PASSWORD}, timeout=PATIENCE_S)
    assert _outcome(again) == (403, "setup_link_invalid")
    with signed_in(hospital, "root.of.all") as administrator:
        assert administrator.get(f"{USERS}/me").json()["roles"] == ["administrator"]


@pytest.mark.parametrize("is_withdrawn", [True, False], ids=["withdrawn", "not yet withdrawn"])
def test_the_link_ends_with_the_first_account_whoever_made_it(
    hospital: Room, tmp_path: Path, *, is_withdrawn: bool
) -> None:
    link = (tmp_path / SETUP_FILE).read_text().strip()
    if not is_withdrawn:
        hospital.gateway.access.accounts.on_create = lambda: None
    add_account(hospital, "dr.a", Role.SURGEON)
    assert (tmp_path / SETUP_FILE).exists() is not is_withdrawn
    url = str(hospital.client.base_url).rstrip("/") + link
    form = {"name": "root.of.all", "password": PASSWORD}
    for answer in (httpx.get(url, timeout=PATIENCE_S), httpx.post(url, data=form, timeout=PATIENCE_S)):
        assert _outcome(answer) == (403, "setup_link_invalid")
        assert "an administrator makes further accounts" in answer.json()["detail"]
    first, token = hospital.gateway.access.first_account, link.partition("token=")[2]
    with hospital.gateway.record.write() as unit, pytest.raises(Refused, match="there is an account already"):
        first.create(unit, token, "root.of.all", "a hash")
    assert [one.name for one in hospital.gateway.access.accounts.all()] == ["dr.a"]


def test_there_is_no_link_where_there_is_an_account(tmp_path: Path) -> None:
    with open_room(tmp_path, demo_token_file=None) as room:
        add_account(room, "nora", Role.ADMINISTRATOR)
    with open_room(tmp_path, demo_token_file=None):
        assert not (tmp_path / SETUP_FILE).exists()


def test_an_administrator_makes_changes_and_disables_accounts(room: Room) -> None:
    made = room.post("/users", {"name": "nora", "password": PASSWORD, "roles": ["viewer"]})
    assert (made.status_code, made.json()["roles"]) == (201, ["viewer"])
    assert _outcome(room.post("/users", {"name": "nora", "password": PASSWORD, "roles": ["viewer"]})) == (
        409,
        "user_exists",
    )
    for name, code in (("robot", "user_name_refused"), ("demo", "user_name_refused"), ("Nora", "request_invalid")):
        refused = room.post("/users", {"name": name, "password": PASSWORD, "roles": ["viewer"]})
        assert _outcome(refused) == (422, code)
    weak = room.post("/users", {"name": "otto", "password": "otto is the best", "roles": ["viewer"]})
    assert _outcome(weak) == (422, "password_refused")
    with signed_in(room, "nora") as nora:
        assert nora.get(f"{USERS}/me").status_code == 200
        changed = room.client.patch(f"{USERS}/nora", json={"roles": ["technician"]})
        assert changed.json()["roles"] == ["technician"]
        assert _outcome(nora.get(f"{USERS}/me")) == (401, "token_invalid"), "what she may do has changed"
    room.client.patch(f"{USERS}/nora", json={"disabled": True})
    login = {"name": "nora", "password": PASSWORD}
    assert _outcome(httpx.post(f"{room.client.base_url}/api/v1/sessions", json=login, timeout=PATIENCE_S)) == (
        401,
        "login_failed",
    )
    assert [one["name"] for one in room.get("/users").json()["items"]] == ["nora"]


def test_the_last_administrator_stays(room: Room) -> None:
    add_account(room, "nora", Role.ADMINISTRATOR)
    for change in ({"disabled": True}, {"roles": ["surgeon"]}):
        assert _outcome(room.client.patch(f"{USERS}/nora", json=change)) == (409, "last_administrator")
    add_account(room, "otto", Role.ADMINISTRATOR)
    assert room.client.patch(f"{USERS}/nora", json={"disabled": True}).json()["disabled"] is True


def test_a_new_password_ends_the_other_sessions(room: Room) -> None:
    add_account(room, "nora", Role.VIEWER)
    with signed_in(room, "nora") as here, signed_in(room, "nora") as there:
        new = {"password": PASSWORD, "new_password": "quite another sentence"}
        wrong = here.put(f"{USERS}/me/password", json=new | {"password": "not the old one"})
        assert _outcome(wrong) == (403, "credential_wrong")
        assert here.put(f"{USERS}/me/password", json=new).status_code == 204
        assert here.get(f"{USERS}/me").status_code == 200
        assert _outcome(there.get(f"{USERS}/me")) == (401, "token_invalid")


@pytest.mark.requirement("GW-01")
def test_approval_asks_for_the_password_again_and_the_permit_says_so(room: Room) -> None:
    add_account(room, "dr.a", Role.SURGEON)
    with signed_in(room, "dr.a") as surgeon:
        opened = surgeon.post("/api/v1/cases", json=samples.case_body(), headers={"Idempotency-Key": new_key()})
        case_id = opened.json()["id"]
        room.image("image", case_id)
        plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]})
        path = f"/api/v1/cases/{case_id}/plans/1/approval"
        headers = {"If-Match": plan.headers["etag"], "Idempotency-Key": new_key()}
        assert _outcome(surgeon.post(path, json={}, headers=headers)) == (403, "credential_missing")
        wrong = surgeon.post(path, json={"password": "not the password"}, headers=headers)
        assert _outcome(wrong) == (403, "credential_wrong")
        assert room.get(f"/cases/{case_id}/plans/1").json()["approval"] is None
        approved = surgeon.post(path, json={"password": PASSWORD}, headers=headers)
        assert (approved.json()["approved_by"], approved.json()["authenticated_by"]) == ("dr.a", "password")
        room.robot.say(MotionState.LOCKED, controller_identity="another")  # comparing passwords took its time
        room.log.wait_for_event(lambda e: getattr(e.data, "controller_identity", "") == "another")
        quoted = {"Idempotency-Key": new_key(), "If-Match": room.etag_for(f"/cases/{case_id}")}
        begun = surgeon.post(f"/api/v1/cases/{case_id}/motions", json={"plan": 1}, headers=quoted)
    room.wait_for_status(begun.json()["id"], "running")
    permit = decode(Permit, room.robot.moves[0].permit.permit_json.encode())
    assert (permit.approver, permit.authenticated_by) == ("dr.a", "password")
    assert _who(room, CaseOpened) + _who(room, PlanApproved) + _who(room, OperationRequested) == ["dr.a"] * 3


def test_from_outside_the_rooms_networks_a_stop_needs_a_login(tmp_path: Path) -> None:
    with open_room(tmp_path, room_networks=("192.0.2.0/24",)) as room:
        for method, path in (("POST", "/api/v1/robot/stop"), ("GET", "/metrics")):
            assert _outcome(httpx.request(method, f"{room.client.base_url}{path}", timeout=PATIENCE_S)) == (
                401,
                "token_missing",
            )
        assert room.client.post("/api/v1/robot/stop").json()["confirmed"] is True
        assert len(room.robot.stops) == 1


def test_in_the_room_an_expired_login_does_not_keep_a_stop_back(room: Room) -> None:
    stale = {"Authorization": "Bearer of-yesterday", "Cookie": "distalock_access=of-yesterday"}
    answer = httpx.post(f"{room.client.base_url}/api/v1/robot/stop", headers=stale, timeout=PATIENCE_S)
    assert answer.json()["confirmed"] is True
    assert httpx.get(f"{room.client.base_url}/metrics", headers=stale, timeout=PATIENCE_S).status_code == 200
