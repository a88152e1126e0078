"""The file of approved parts: it grows, and what it does not say is not approved."""

import stat
from datetime import UTC, datetime
from pathlib import Path

import pytest

from shared.errors import ConfigurationError
from shared.parts.approvals import APPROVALS_FILE, PartApprovals, approval_of

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)
RING: dict[str, object] = {
    "schema": "distalock/ring/1",
    "units": "mm",
    "balls": [{"id": "1", "position_mm": [0.5, 1, 2.0]}],
}
SHA256 = "a" * 64


def test_nothing_is_approved_before_somebody_has(tmp_path: Path) -> None:
    assert not PartApprovals(tmp_path).holds(SHA256)


def test_an_approval_names_who_when_and_what_and_is_private(tmp_path: Path) -> None:
    approvals = PartApprovals(tmp_path / "state")
    approvals.add(approval_of(RING, SHA256, "ring.json", "Dr A", NOW))
    approvals.add(approval_of(RING, "0" * 64, "other.json", "Dr B", NOW))
    assert approvals.holds(SHA256)
    assert [(one.file_name, one.approved_by, one.approved_at) for one in approvals.all()] == [
        ("ring.json", "Dr A", NOW),
        ("other.json", "Dr B", NOW),
    ]
    assert stat.S_IMODE((tmp_path / "state" / APPROVALS_FILE).stat().st_mode) == 0o600


@pytest.mark.parametrize("end", ["\u2028", "\u0085", "\x1c"])
def test_any_end_of_a_line_may_stand_in_a_name(tmp_path: Path, end: str) -> None:
    approvals = PartApprovals(tmp_path)
    for sha256 in (SHA256, "0" * 64):
        approvals.add(approval_of(RING, sha256, f"ring{end}.json", f"Dr{end}A", NOW))
    assert [(one.file_name, one.approved_by) for one in approvals.all()] == [(f"ring{end}.json", f"Dr{end}A")] * 2


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    approvals = PartApprovals(tmp_path)
    approvals.add(approval_of(RING, SHA256, "ring.json", "Dr A", NOW))
    with (tmp_path / APPROVALS_FILE).open("a") as file:
        file.write("all\n")
    with pytest.raises(
        ConfigurationError, match=r"approved-parts.jsonl, line 2 is no approval; put back what was there"
    ):
        approvals.holds(SHA256)
