"""De-identified: nothing of the patient, the people and the place is left anywhere in the folder."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pydicom
import pytest

from services.ui_api.record.database import existing_database, sqlite_url
from services.ui_api.record.deidentify.case import NOTES, deidentified
from services.ui_api.record.deidentify.dicom import BurnedInText, deidentified_dicom
from services.ui_api.record.deidentify.fields import FieldCleaner
from services.ui_api.record.deidentify.pseudonyms import Pseudonyms
from services.ui_api.record.deidentify.table import DICOM_RULES, RECORD_RULES, table_lines
from services.ui_api.record.export.content import read_case
from services.ui_api.record.export.folder import write_folder
from tests.unit.services.ui_api.record.handed_over import COLUMNS, ROOT, ROWS, case_of_smith, dicom_of_smith

_PAGE = (Path(__file__).parents[5] / "docs" / "record.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The de-identified folder, and texts that must not be in it."""
    state, out = tmp_path_factory.mktemp("state"), tmp_path_factory.mktemp("out") / "case"
    case_id = case_of_smith(state)
    case = read_case(existing_database(sqlite_url(state)), state / "images", case_id)
    write_folder(deidentified(case), out, NOTES)
    hashes = [image.sha256 for image in case.images]
    hashes += [document.sha256 for document in case.documents if document.media_type != "image/png"]  # kept as it is
    dates = [str(event["at"])[:10] for event in case.events] + [str(event["at_ns"])[:8] for event in case.events]
    return out, [case_id, ROOT, "smith", "19620304", *hashes, *(h[:12] for h in hashes), *dates]


def test_nothing_of_anybody_is_left(folder: tuple[Path, list[str]]) -> None:
    out, forbidden = folder
    for file in (p for p in out.rglob("*") if p.is_file()):
        content = file.read_bytes().lower()
        found = [text for text in forbidden if text.lower().encode() in content or text in file.name]
        assert not found, (file.name, found)


def _check(folder: Path, *given: str) -> tuple[int, str]:
    command = [sys.executable, "-I", "check.py", *given]
    checked = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert not checked.stderr, checked.stderr
    return checked.returncode, checked.stdout


def test_a_stranger_can_check_the_files_and_learns_that_there_is_no_chain(folder: tuple[Path, list[str]]) -> None:
    out, _ = folder
    code, printed = _check(out)
    assert code == 0
    assert (
        "de-identified: there is no chain; events, documents and images were compared with SHA256SUMS alone" in printed
    )
    assert "SHA-256 of SHA256SUMS: " in printed
    assert "head of the record" not in printed
    assert _check(out, "--head", "a" * 64) == (1, f"head of the record: not in this export; expected was {'a' * 64}\n")
    assert "and nothing more: there is no chain" in (out / "README.md").read_text()


def test_the_procedure_can_still_be_followed(folder: tuple[Path, list[str]]) -> None:
    out, _ = folder
    events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    assert (events[0]["kind"], events[0]["at"], events[0]["at_ns"]) == ("case_opened", "0.000 s", 0)
    assert {e["who"] for e in events} <= {"person-1", "person-2", "person-3", "gateway", "imaging", "registration"}
    setup = events[0]["data"]["setup"]
    assert (setup["side"], setup["bone"], setup["head_extension_mm"]) == ("left", "femur", 60.0)
    plan = next(e["data"]["plan_sha256"] for e in events if e["kind"] == "plan_made")
    assert (out / "documents" / f"{plan}.json").is_file(), "what names a document still does"
    received = [e["data"] for e in events if e["kind"] == "image_received"]
    image = pydicom.dcmread(next((out / "images").glob("*.dcm")))
    assert image.SOPInstanceUID == received[-1]["sop_instance_uid"], "event and image still belong together"


def test_the_image_can_still_be_measured_and_says_what_was_done() -> None:
    image = pydicom.dcmread(io.BytesIO(deidentified_dicom(dicom_of_smith(), Pseudonyms())))
    assert (image.PatientIdentityRemoved, image.PatientName, image.PatientID) == ("YES", "", "")
    assert image.DeidentificationMethodCodeSequence[0].CodeValue == "113100"
    assert (image.ImagerPixelSpacing, image.DistanceSourceToDetector, image.Laterality) == ([0.2, 0.2], 1000.0, "L")
    assert "InstitutionName" not in image
    assert not [element for element in image if element.tag.is_private]
    expected = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS) * 100
    assert np.array_equal(image.pixel_array, expected), "without the overlay in the unused bit"


def test_objects_of_one_study_stay_together_and_lead_nowhere() -> None:
    names = Pseudonyms()
    one, two = (pydicom.dcmread(io.BytesIO(deidentified_dicom(dicom_of_smith(n), names))) for n in (1, 2))
    assert one.StudyInstanceUID == two.StudyInstanceUID != one.SeriesInstanceUID
    assert one.SOPInstanceUID != two.SOPInstanceUID
    again = pydicom.dcmread(io.BytesIO(deidentified_dicom(dicom_of_smith(), Pseudonyms())))
    assert again.StudyInstanceUID != one.StudyInstanceUID, "not even with another export of the same case"


def test_an_image_with_burned_in_text_is_left_out() -> None:
    with pytest.raises(BurnedInText):
        deidentified_dicom(dicom_of_smith(BurnedInAnnotation="YES"), Pseudonyms())


def test_text_that_no_list_names_is_removed_at_any_depth() -> None:
    cleaner = FieldCleaner(Pseudonyms(), 1000)
    found = cleaner.value("", {"a": [{"name": "Smith", "verdict": "accepted", "sent_at_ns": 1500, "x_mm": 1.5}]})
    assert found == {"a": [{"name": "", "verdict": "accepted", "sent_at_ns": 500, "x_mm": 1.5}]}


@pytest.mark.parametrize(("rules", "first"), [(DICOM_RULES, "attribute"), (RECORD_RULES, "field")])
def test_the_page_prints_the_table(rules: tuple[object, ...], first: str) -> None:
    table = "\n".join(table_lines(rules, first))  # type: ignore[arg-type]
    assert table in _PAGE, f"put this into docs/record.md:\n{table}"
