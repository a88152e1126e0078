"""What the doctor finds, over REST: the machine, the folder, what runs, each with a remedy."""

from datetime import UTC, datetime

from services.ui_api.core.roles import Role
from shared.bus.tls import PKI_FOLDER
from shared.pki.keystore import Keystore
from tests.unit.services.ui_api.people import add_account, signed_in
from tests.unit.services.ui_api.room import Room


def findings(room: Room) -> dict[str, dict[str, str]]:
    return {one["name"]: one for one in room.get("/diagnosis").json()["findings"]}


def test_machine_folder_and_running_parts_are_looked_at(room: Room) -> None:
    found = findings(room)
    assert {"processors", "memory", "clock", "disk", "parts", "certificates (bus)", "running: database"} <= set(found)
    assert found["certificates (bus)"]["verdict"] == "not looked at", "this folder has no authority"
    assert found["running: database"] == {
        "name": "running: database",
        "verdict": "well",
        "measured": "a row was written and the newest event read",
        "remedy": "",
    }
    assert all(one["remedy"] for one in found.values() if one["verdict"] in ("wrong", "attention"))


def test_the_worst_is_said_first_and_has_a_remedy(room: Room) -> None:
    folder = room.gateway.diagnosis.state_dir
    Keystore(folder / PKI_FOLDER).ensure(datetime(1990, 1, 1, tzinfo=UTC))
    answer = room.get("/diagnosis").json()
    certificates = next(one for one in answer["findings"] if one["name"] == "certificates (bus)")
    assert answer["verdict"] == certificates["verdict"] == "wrong"
    assert certificates["remedy"] == "`distalock pki rotate`"


def test_a_viewer_is_not_told(room: Room) -> None:
    add_account(room, "vera", Role.VIEWER)
    with signed_in(room, "vera") as client:
        assert client.get("/api/v1/diagnosis").status_code == 403
