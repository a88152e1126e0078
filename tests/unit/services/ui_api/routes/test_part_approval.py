"""Part files that no administrator has approved."""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path

import pytest

from shared.parts.approvals import PartApprovals, approval_of
from shared.parts.canonical import part_sha256
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, open_room

GUIDE = json.loads((files("shared.parts") / "catalogue" / "guide-28.json").read_text())
SHIPPED: dict[str, object] = {"ring": "ring-120", "guide": "guide-28", "nail": "nail-femur-ti-10"}
SHA256 = part_sha256(json.dumps(GUIDE).encode(), "file")


@pytest.fixture
def careful_room(tmp_path: Path) -> Iterator[Room]:
    with open_room(tmp_path, unapproved_parts=False) as opened:
        yield opened


@pytest.mark.requirement("GW-12")
def test_an_unapproved_file_is_refused_with_its_hash_and_the_remedy(careful_room: Room, tmp_path: Path) -> None:
    body = samples.case_body() | SHIPPED | {"guide": GUIDE}
    answer = careful_room.post("/cases", body)
    assert answer.status_code == 422
    assert answer.json()["code"] == "part_not_approved"
    assert SHA256 in answer.json()["detail"]
    assert "distalock parts approve FILE" in answer.json()["detail"]
    PartApprovals(tmp_path).add(approval_of(GUIDE, SHA256, "guide.json", "Dr A", datetime.now(UTC)))
    assert careful_room.post("/cases", body).status_code == 201


def test_the_catalogue_needs_no_approval_and_a_calibration_does(careful_room: Room) -> None:
    opened = careful_room.post("/cases", samples.case_body() | SHIPPED)
    assert opened.status_code == 201
    answer = careful_room.patch(f"/cases/{opened.json()['id']}", {"guide_calibration": GUIDE})
    assert answer.json()["code"] == "part_not_approved"
