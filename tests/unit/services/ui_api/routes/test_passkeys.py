"""A passkey approves the plan that it has signed for: once, in its session, by its own user."""

from collections.abc import Iterator

import httpx
import pytest

from services.ui_api.core.roles import Role
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.people import PASSWORD, add_account, signed_in
from tests.unit.services.ui_api.room import Room, new_key
from tests.unit.services.ui_api.software_passkey import SoftwarePasskey

ME = "/api/v1/users/me/passkeys"


def _outcome(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


@pytest.fixture
def surgeon(room: Room) -> Iterator[httpx.Client]:
    add_account(room, "dr.a", Role.SURGEON)
    with signed_in(room, "dr.a") as client:
        yield client


def _registered(client: httpx.Client, passkey: SoftwarePasskey, **more: str) -> httpx.Response:
    options = client.post(f"{ME}/registration")
    assert options.status_code == 200, options.text
    body = {"label": "phone", "password": PASSWORD, "credential": passkey.made_for(options.json()["public_key"])}
    return client.post(ME, json=body | more)


class Plan:
    """A plan that waits for its approval."""

    def __init__(self, room: Room, surgeon: httpx.Client) -> None:
        opened = surgeon.post("/api/v1/cases", json=samples.case_body(), headers={"Idempotency-Key": new_key()})
        case_id = opened.json()["id"]
        room.image("image", case_id)
        made = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]})
        self.etag = made.headers["etag"]
        self.sha256 = self.etag.strip('"')
        self._surgeon, self._path = surgeon, f"/api/v1/cases/{case_id}/plans/1/approval"

    def approved(self, passkey: dict[str, object], key: str | None = None) -> httpx.Response:
        headers = {"If-Match": self.etag, "Idempotency-Key": key or new_key()}
        return self._surgeon.post(self._path, json={"passkey": passkey}, headers=headers)


def _challenge(client: httpx.Client, plan_sha256: str) -> dict[str, object]:
    asked = client.post(f"{ME}/challenge", json={"plan_sha256": plan_sha256})
    assert asked.status_code == 200, asked.text
    options: dict[str, object] = asked.json()["public_key"]
    return options


def test_a_passkey_approves_the_plan_that_it_signed_for_once(room: Room, surgeon: httpx.Client) -> None:
    passkey = SoftwarePasskey()
    assert _registered(surgeon, passkey).status_code == 201
    plan = Plan(room, surgeon)
    for_another = passkey.signed(_challenge(surgeon, "0" * 64))
    assert _outcome(plan.approved(for_another)) == (403, "challenge_of_another_plan")
    signed = passkey.signed(_challenge(surgeon, plan.sha256))
    key = new_key()
    approved = plan.approved(signed, key)
    assert (approved.status_code, approved.json()["authenticated_by"]) == (201, "passkey")
    assert plan.approved(signed, key).json() == approved.json(), "sent again, it is answered again"
    assert _outcome(plan.approved(signed)) == (403, "challenge_missing")


def test_what_a_passkey_must_not_be(room: Room, surgeon: httpx.Client) -> None:
    plan, passkey = Plan(room, surgeon), SoftwarePasskey()
    assert _outcome(surgeon.post(f"{ME}/challenge", json={"plan_sha256": plan.sha256})) == (409, "no_passkey")
    assert _registered(surgeon, passkey).status_code == 201
    stranger = SoftwarePasskey()
    assert _outcome(plan.approved(stranger.signed(_challenge(surgeon, plan.sha256)))) == (403, "credential_wrong")
    passkey.uses = -1  # signs with a counter that was seen before
    assert plan.approved(passkey.signed(_challenge(surgeon, plan.sha256))).status_code == 201
    copied = SoftwarePasskey()
    assert _registered(surgeon, copied).status_code == 201
    copied.uses = 41
    another = plan.approved(copied.signed(_challenge(surgeon, plan.sha256)))
    assert _outcome(another) == (409, "plan_already_approved"), another.text
    copied.uses = 7
    assert _outcome(plan.approved(copied.signed(_challenge(surgeon, plan.sha256)))) == (403, "passkey_copied")


@pytest.mark.parametrize(
    "passkey",
    [
        SoftwarePasskey(origin="https://localhost.evil.example"),
        SoftwarePasskey(host="evil.example"),
        SoftwarePasskey(verifies_user=False),
    ],
    ids=["another origin", "another host", "no finger, no PIN"],
)
def test_a_passkey_of_another_place_is_not_taken(surgeon: httpx.Client, passkey: SoftwarePasskey) -> None:
    assert _outcome(_registered(surgeon, passkey)) == (403, "passkey_invalid")
    assert surgeon.get(ME).json()["items"] == []


def test_registering_one_asks_for_the_password(room: Room, surgeon: httpx.Client) -> None:
    assert _outcome(_registered(surgeon, SoftwarePasskey(), password="not the password")) == (403, "credential_wrong")
    assert _outcome(room.client.post(ME, json={"label": "x", "credential": {}})) == (409, "demo_user")
    assert _outcome(surgeon.post(ME, json={"label": "x", "password": PASSWORD, "credential": {}})) == (
        403,
        "passkey_invalid",
    )


def test_a_lost_phone_is_taken_away_by_its_user_or_an_administrator(room: Room, surgeon: httpx.Client) -> None:
    first = _registered(surgeon, SoftwarePasskey()).json()["id"]
    assert surgeon.delete(f"{ME}/{first}").status_code == 204
    assert _outcome(surgeon.delete(f"{ME}/{first}")) == (404, "passkey_not_found")
    _registered(surgeon, SoftwarePasskey())
    assert surgeon.delete("/api/v1/users/dr.a/passkeys").status_code == 403
    assert room.client.delete("/api/v1/users/dr.a/passkeys").status_code == 204
    assert surgeon.get(ME).json()["items"] == []
    changes = [event.data.change for event in room.gateway.record.events_after(0) if hasattr(event.data, "change")]
    assert changes.count("passkey_added") == 2
    assert changes.count("passkey_removed") == 2
