"""`distalock parts`: what it approves, and what it refuses."""

import json
from importlib.resources import files
from pathlib import Path

import pytest

from distalock.__main__ import main
from shared.parts.approvals import PartApprovals, canonical_part
from shared.parts.files import sha256_of

RING = json.loads((files("shared.parts") / "catalogue" / "ring-120.json").read_text())


def parts(state: Path, *words: str) -> int:
    return main(["parts", *words, "--state", str(state)])


def test_a_file_is_approved_once_under_the_gateway_s_hash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(RING, indent=4))
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A") == 0
    sha256 = sha256_of(canonical_part(RING))
    assert capsys.readouterr().out == f"{sha256}  ours.json  approved\n"
    assert PartApprovals(tmp_path).holds(sha256)
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A") == 0
    assert "was approved before" in capsys.readouterr().out
    assert parts(tmp_path, "list") == 0
    listed = capsys.readouterr().out.splitlines()
    assert any("ring-120  comes with the package" in line for line in listed)
    assert [line for line in listed if "by Dr A" in line] == listed[-1:]


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("no JSON", "not JSON; name a part file"),
        ("[]", "its schema is ''"),
        (json.dumps(RING | {"ball_count": 1}), "ball_count"),
        (json.dumps(RING | {"schema": "distalock/scenario/1"}), "its schema is 'distalock/scenario/1'"),
    ],
)
def test_what_is_no_part_is_not_approved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, why: str
) -> None:
    file = tmp_path / "ours.json"
    file.write_text(content)
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A") == 2
    assert why in capsys.readouterr().err
    assert PartApprovals(tmp_path).all() == ()


def test_nobody_approves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(RING))
    assert parts(tmp_path, "approve", str(file), "--by", "") == 2
    assert "give --by the name" in capsys.readouterr().err
