"""`distalock parts`: what it approves, and what it refuses."""

import json
from importlib.resources import files
from pathlib import Path

import pytest

from distalock.__main__ import main
from shared.parts.approvals import PartApprovals
from shared.parts.canonical import part_sha256

RING = json.loads((files("shared.parts") / "catalogue" / "ring-120.json").read_text())
GUIDE = json.loads((files("shared.parts") / "catalogue" / "guide-28.json").read_text())
NAIL = json.loads((files("shared.parts") / "catalogue" / "nail-femur-ti-10.json").read_text())
# Balls of either plate, one above the other.
RING_LENGTH = ("--length", "R024", "R015", "76.14")


def parts(state: Path, *words: str) -> int:
    return main(["parts", *words, "--state", str(state)])


def test_a_file_is_approved_once_under_the_gateway_s_hash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(RING, indent=4))
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A", *RING_LENGTH) == 0
    sha256 = part_sha256(json.dumps(RING).encode(), "file")
    assert capsys.readouterr().out == f"{sha256}  ours.json  approved\n"
    assert PartApprovals(tmp_path).holds(sha256)
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A", *RING_LENGTH) == 0
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
    assert parts(tmp_path, "approve", str(file), "--by", "", *RING_LENGTH) == 2
    assert "give --by the name" in capsys.readouterr().err


@pytest.mark.requirement("OPS-04")
@pytest.mark.parametrize(
    ("part", "length", "why"),
    [
        (GUIDE, (), "no single image shows whether a ring or guide has the size of its file"),
        # 1 % larger than its file
        (GUIDE, ("G06", "G14", "63.53"), "62.90 mm apart: +1.0% (limit 0.3%)"),
        (GUIDE, ("G00", "G01", "8"), "name two balls at least 37.7 mm apart (60% of the longest distance)"),
        (GUIDE, ("G06", "G28", "62.9"), "the file has no ball 'G28'"),
        (GUIDE, ("G06", "G06", "62.9"), "'G06' is named twice"),
        (GUIDE, ("G06", "G14", "nan"), "'nan' is no length in mm"),
        # plates 1 mm nearer together
        (RING, ("R024", "R015", "75.14"), "76.14 mm apart: -1.3% (limit 0.3%)"),
        (RING, ("R000", "R002", "60"), "of the way is along the beam (at least 70%)"),
        (NAIL, ("G06", "G14", "62.9"), "leave out --length"),
    ],
)
def test_a_ring_or_guide_is_approved_only_with_the_size_of_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], part: object, length: tuple[str, ...], why: str
) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(part))
    option = ("--length", *length) if length else ()
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A", *option) == 2
    assert why in capsys.readouterr().err
    assert PartApprovals(tmp_path).all() == ()


def test_the_length_is_kept_with_the_approval_and_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(GUIDE))
    assert parts(tmp_path, "approve", str(file), "--by", "Dr A", "--length", "G06", "G14", "62.95") == 0
    assert parts(tmp_path, "list") == 0
    assert "by Dr A, G06 to G14 measured as 62.95 mm" in capsys.readouterr().out


def test_the_hash_of_a_file_is_the_part_s(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "ours.json"
    file.write_text(json.dumps(RING, indent=4))
    assert main(["parts", "hash", str(file)]) == 0
    assert capsys.readouterr().out == f"{part_sha256(json.dumps(RING).encode(), 'file')}  ours.json\n"
    file.write_text("no JSON")
    assert main(["parts", "hash", str(file)]) == 2
    assert "ours.json: not JSON; name a part file" in capsys.readouterr().err
