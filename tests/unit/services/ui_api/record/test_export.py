"""A case as a folder: complete, checkable by a stranger, and explained."""

import contextlib
import itertools
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.record import verify
from services.ui_api.record.database import existing_database, open_database, sqlite_url
from services.ui_api.record.export import check
from services.ui_api.record.export.content import png_of_dicom, read_case
from services.ui_api.record.export.folder import WrittenFolder, write_folder
from services.ui_api.record.record import CaseRecord
from shared.errors import InputError
from shared.parts.files import sha256_of
from tests.unit.services.ui_api.record.filled import STEP, fill
from tests.unit.services.ui_api.record.handed_over import case_of_smith, dicom_of_smith


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """State folder, and the id of a case in it."""
    folder = tmp_path_factory.mktemp("state")
    return folder, case_of_smith(folder)


def _export(state: tuple[Path, str], out: Path) -> WrittenFolder:
    folder, case_id = state
    return write_folder(read_case(existing_database(sqlite_url(folder)), folder / "images", case_id), out)


def _check(folder: Path, *given: object) -> "subprocess.CompletedProcess[str]":
    """As a stranger would: with Python alone, and not from within this project."""
    command = [sys.executable, "-I", "check.py", *map(str, given)]
    checked = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert not checked.stderr, checked.stderr
    return checked


def _rewrite_sums(folder: Path) -> None:
    """As somebody does who changed files and does not want it to be seen."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "SHA256SUMS")
    sums = "".join(f"{sha256_of(p.read_bytes())}  {p.relative_to(folder)}\n" for p in files)
    (folder / "SHA256SUMS").write_text(sums)


def _objects(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text().split("\n") if line]


def _write_objects(file: Path, objects: list[dict[str, Any]]) -> None:
    file.write_text("".join(json.dumps(one, ensure_ascii=False) + "\n" for one in objects))


def test_a_stranger_can_check_it(state: tuple[Path, str], tmp_path: Path) -> None:
    written = _export(state, tmp_path / "out")
    checked = _check(tmp_path / "out")
    assert checked.returncode == 0, checked.stdout
    events, chain = (_objects(tmp_path / "out" / f"{name}.jsonl") for name in ("events", "chain"))
    missing = next(e["data"]["image_sha256"] for e in events if e["kind"] == "image_received")
    own = f"with their content it covers the last {_own_at_the_end(events, chain)} of the case"
    assert checked.stdout.splitlines() == [
        "all files are as SHA256SUMS names them",
        "events are as the chain names them, documents and images as the events name them",
        f"not here, README.md states why: image {missing}",
        f"SHA-256 of SHA256SUMS: {written.sums_sha256} (not compared)",
        f"events of the case: {len(events)} (not compared)",
        f"head of the record: {chain[-1]['sha256']} (not compared); {own}",
        "compare these with what you were given another way: until then nothing shows that all was not rewritten",
    ]
    assert (written.events, written.head_sha256) == (len(events), chain[-1]["sha256"])
    assert written.files == sum(1 for p in (tmp_path / "out").rglob("*") if p.is_file())
    summed = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=tmp_path / "out", check=False)
    assert summed.returncode == 0


def _own_at_the_end(events: list[dict[str, Any]], chain: list[dict[str, Any]]) -> int:
    own = {event["sequence"] for event in events}
    return len(list(itertools.takewhile(lambda link: link["sequence"] in own, reversed(chain))))


def test_what_was_sent_another_way_is_compared(state: tuple[Path, str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    written = _export(state, out)
    given = ("--sums", written.sums_sha256.upper(), "--events", written.events, "--head", written.head_sha256)
    checked = _check(out, *given)
    assert (checked.returncode, checked.stdout.count("(as expected)")) == (0, 3)
    assert "nothing shows" not in checked.stdout
    other = _check(out, "--sums", "a" * 64, "--events", 1, "--head", "b" * 64)
    assert (other.returncode, other.stdout.splitlines()) == (
        1,
        [
            f"SHA-256 of SHA256SUMS: {written.sums_sha256}; expected was {'a' * 64}",
            f"number of events of the case: {written.events}; expected was 1",
            f"head of the record: {written.head_sha256}; expected was {'b' * 64}",
        ],
    )


def test_a_folder_can_be_checked_from_elsewhere(state: tuple[Path, str], tmp_path: Path) -> None:
    _export(state, tmp_path / "out")
    (tmp_path / "check.py").write_bytes((tmp_path / "out" / "check.py").read_bytes())
    assert _check(tmp_path, "out").returncode == 0
    assert _check(tmp_path).stdout == "SHA256SUMS: No such file or directory\n"


def test_the_check_knows_the_keys_by_which_events_name_documents() -> None:
    assert check.DOCUMENT_KEYS == verify._NAMES_A_DOCUMENT


def _change_plan(out: Path) -> None:
    plan = next(e["data"]["plan_sha256"] for e in _objects(out / "events.jsonl") if e["kind"] == "plan_made")
    file = out / "documents" / f"{plan}.json"
    file.write_text(re.sub(r"\d\.\d+", "9.99", file.read_text()))


def _change_image(out: Path) -> None:
    image = next((out / "images").glob("*.dcm"))
    image.write_bytes(image.read_bytes()[:-1] + b"?")


def _change_event_without_chain(out: Path) -> None:
    (out / "chain.jsonl").unlink()
    events = _objects(out / "events.jsonl")
    events[0]["data"]["setup"]["side"] = "right"
    _write_objects(out / "events.jsonl", events)


def _swap_events(out: Path) -> None:
    first, second, *others = _objects(out / "events.jsonl")
    _write_objects(out / "events.jsonl", [second, first, *others])


def _cut_chain(out: Path) -> None:
    _write_objects(out / "chain.jsonl", _objects(out / "chain.jsonl")[:-1])


def _set_kind_of_number(out: Path) -> None:
    events = _objects(out / "events.jsonl")
    _write_objects(out / "events.jsonl", [events[0] | {"sequence": [1]}])


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        (_change_plan, r"documents/[0-9a-f]{64}\.json was changed: its content does not give the hash by which events"),
        (
            _change_image,
            r"images/002-[0-9a-f]{12}\.dcm was changed: its content does not give the hash by which events",
        ),
        (
            lambda out: next((out / "documents").glob("*.json")).unlink(),
            r"document [0-9a-f]{64}, which an event names, is",
        ),
        (lambda out: (out / "documents" / "new.json").write_text("{}"), r"documents/new\.json: no event names it"),
        (
            lambda out: (out / "images" / "003-0.dcm").write_text(""),
            r"images/003-0\.dcm: no event names it at this place",
        ),
        (
            lambda out: next((out / "images").glob("*.dcm")).unlink(),
            r"image [0-9a-f]{64}, which an event names, is missing, and README\.md does not state why",
        ),
        (lambda out: (out / "chain.jsonl").unlink(), r"chain\.jsonl is missing: only a de-identified export"),
        (_change_event_without_chain, r"chain\.jsonl is missing: only a de-identified export"),
        (_swap_events, r"event \d+ stands after event \d+"),
        (_cut_chain, r"events\.jsonl: event \d+ is not in chain\.jsonl"),
        (lambda out: (out / "events.jsonl").write_text(""), r"events\.jsonl has no event"),
        (
            lambda out: (out / "events.jsonl").write_text("{\n"),
            r"events\.jsonl: line 1 lacks everything: it is no object",
        ),
        (
            lambda out: (out / "events.jsonl").write_text("{}\n"),
            r"events\.jsonl: line 1 lacks sequence, at_ns, case_id",
        ),
        (_set_kind_of_number, r"events\.jsonl or chain\.jsonl has a value of another kind"),
    ],
)
def test_a_rewritten_list_of_hashes_hides_nothing(
    state: tuple[Path, str], tmp_path: Path, change: Callable[[Path], object], finding: str
) -> None:
    _export(state, tmp_path / "out")
    change(tmp_path / "out")
    _rewrite_sums(tmp_path / "out")
    checked = _check(tmp_path / "out")
    assert checked.returncode == 1
    assert re.search(finding, checked.stdout), checked.stdout


def test_a_file_that_was_added_is_named(state: tuple[Path, str], tmp_path: Path) -> None:
    _export(state, tmp_path / "out")
    (tmp_path / "out" / "report-corrected.html").write_text("")
    assert _check(tmp_path / "out").stdout == "report-corrected.html is not named in SHA256SUMS\n"


def test_an_event_that_was_removed_shows_with_the_number_of_events(state: tuple[Path, str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    written = _export(state, out)
    events = _objects(out / "events.jsonl")
    _write_objects(out / "events.jsonl", [event for event in events if event["kind"] != "step_recorded"])
    _rewrite_sums(out)
    assert f"events of the case: {len(events) - 1} (not compared)" in _check(out).stdout
    checked = _check(out, "--events", written.events, "--head", written.head_sha256)
    assert checked.stdout == f"number of events of the case: {len(events) - 1}; expected was {len(events)}\n"
    assert checked.returncode == 1


def test_an_event_before_one_of_others_shows_with_the_hash_of_all_files_alone(tmp_path: Path) -> None:
    """What README.md of an export admits: a hash of content that is not here cannot be computed anew."""
    with contextlib.closing(CaseRecord(open_database(sqlite_url(tmp_path)), lambda: 1)) as record:
        fill(record)
        record.append(EventDraft(GatewayStarted("epoch", "1"), None, "gateway"))
    out = tmp_path / "out"
    written = write_folder(read_case(existing_database(sqlite_url(tmp_path)), tmp_path / "images", "case-1"), out)
    events, chain = _objects(out / "events.jsonl"), _objects(out / "chain.jsonl")
    events[-1]["who"] = "somebody else"
    events[-1]["sha256"] = chain[1]["sha256"] = chain[2]["previous_sha256"] = check.event_sha256(events[-1])
    _write_objects(out / "events.jsonl", events)
    _write_objects(out / "chain.jsonl", chain)
    _rewrite_sums(out)
    by_head = _check(out, "--events", 2, "--head", written.head_sha256)
    assert by_head.returncode == 0
    assert "with their content it covers the last 0 of the case" in by_head.stdout
    assert "nothing shows that all was not rewritten" in by_head.stdout
    assert _check(out, "--sums", written.sums_sha256).returncode == 1


@pytest.mark.parametrize("end", ["\u2028", "\u2029", "\u0085", "\x0b", "\x1c", "\r\n"])
def test_any_end_of_a_line_may_stand_in_a_reason(tmp_path: Path, end: str) -> None:
    with contextlib.closing(CaseRecord(open_database(sqlite_url(tmp_path)), lambda: 1)) as record:
        fill(record)
        record.append(replace(STEP, why=f"first{end}second"))
    case = read_case(existing_database(sqlite_url(tmp_path)), tmp_path / "images", "case-1")
    written = write_folder(case, tmp_path / "out")
    assert _objects(tmp_path / "out" / "events.jsonl")[-1]["why"] == f"first{end}second"
    checked = _check(tmp_path / "out", "--events", 3, "--head", written.head_sha256)
    assert checked.returncode == 0, checked.stdout
    assert "with their content it covers the last 3 of the case" in checked.stdout


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
