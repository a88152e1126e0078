"""A case as a folder: complete, checkable by a stranger, and explained."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from services.ui_api.record.database import existing_database, sqlite_url
from services.ui_api.record.export.content import png_of_dicom, read_case
from services.ui_api.record.export.folder import WrittenFolder, write_folder
from shared.errors import InputError
from shared.parts.files import sha256_of
from tests.unit.services.ui_api.record.handed_over import case_of_smith, dicom_of_smith


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """State folder, and the id of a case in it."""
    folder = tmp_path_factory.mktemp("state")
    return folder, case_of_smith(folder)


def _export(state: tuple[Path, str], out: Path) -> WrittenFolder:
    folder, case_id = state
    return write_folder(read_case(existing_database(sqlite_url(folder)), folder / "images", case_id), out)


def _check(folder: Path) -> "subprocess.CompletedProcess[str]":
    """As a stranger would: with Python alone, and not from within this project."""
    return subprocess.run([sys.executable, "-I", "check.py"], cwd=folder, check=False, capture_output=True, text=True)


def test_a_stranger_can_check_it(state: tuple[Path, str], tmp_path: Path) -> None:
    written = _export(state, tmp_path / "out")
    checked = _check(tmp_path / "out")
    assert (checked.returncode, checked.stdout) == (0, "all files are as they were exported\n"), checked.stderr
    assert written.files == sum(1 for p in (tmp_path / "out").rglob("*") if p.is_file())
    summed = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=tmp_path / "out", check=False)
    assert summed.returncode == 0


def test_every_file_is_explained_and_every_document_is_there(state: tuple[Path, str], tmp_path: Path) -> None:
    _export(state, tmp_path / "out")
    page = (tmp_path / "out" / "README.md").read_text()
    explained = set(re.findall(r"^\| `([^`]+)`", page, re.MULTILINE))
    assert explained == {p.name for p in (tmp_path / "out").iterdir()} - {"README.md"}
    events = [json.loads(line) for line in (tmp_path / "out" / "events.jsonl").read_text().splitlines()]
    kinds = [event["kind"] for event in events]
    assert kinds[0] == "case_opened"
    assert "plan_approved" in kinds
    documents = {p.stem for p in (tmp_path / "out" / "documents").iterdir()}
    plan = next(event["data"]["plan_sha256"] for event in events if event["kind"] == "plan_made")
    assert plan in documents
    assert all(sha256_of(p.read_bytes()) == p.stem for p in (tmp_path / "out" / "documents").iterdir())
    images = sorted((tmp_path / "out" / "images").iterdir())
    assert [p.suffix for p in images] == [".dcm", ".png"]
    assert images[0].read_bytes() == dicom_of_smith()


def test_the_report_shows_what_happened_without_outside_addresses(state: tuple[Path, str], tmp_path: Path) -> None:
    written = _export(state, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    for shown in ("case opened", "plan approved", "Mrs Smith felt unwell", "left", "femur"):
        assert shown in page
    assert "http" not in page
    for picture in re.findall(r'src="([^"]+)"', page):
        assert (tmp_path / "out" / picture).is_file()
    assert len(written.missing) == 1, "the fake imaging stores no file"
    assert "is not in the image store" in page


@pytest.mark.parametrize(
    ("name", "old", "new", "finding"),
    [
        ("report.html", "femur", "tibia", "report.html was changed"),
        ("events.jsonl", "Mrs Smith", "Mr Smith", r"event \d+ was changed: its content does not give its hash"),
        ("chain.jsonl", '"sequence": 2,', '"sequence": 3,', "event 2 does not follow the one before it"),
    ],
)
def test_what_was_changed_is_named(
    state: tuple[Path, str], tmp_path: Path, name: str, old: str, new: str, finding: str
) -> None:
    _export(state, tmp_path / "out")
    file = tmp_path / "out" / name
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    checked = _check(tmp_path / "out")
    assert checked.returncode == 1
    assert re.search(finding, checked.stdout), checked.stdout


def test_what_is_no_case_is_refused(state: tuple[Path, str], tmp_path: Path) -> None:
    folder, case_id = state
    with pytest.raises(InputError, match=rf"there is no case 'x'; the record has {case_id}"):
        read_case(existing_database(sqlite_url(folder)), folder / "images", "x")
    with pytest.raises(InputError, match="is not an empty folder; an export needs one of its own"):
        _export(state, folder)


def test_what_is_no_image_has_no_picture() -> None:
    assert png_of_dicom(b"nothing") is None
