"""A case with people in it, wherever they may be: what an export shows and a de-identified one must not."""

import io
from pathlib import Path

import numpy as np
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import UID, ExplicitVRLittleEndian, XRayAngiographicImageStorage

from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.events import EventDraft
from services.ui_api.record.images import stored_paths
from services.ui_api.record.record import CaseRecord
from shared.parts.files import sha256_of
from tests.unit.services.ui_api.room import open_room

ROOT = "1.2.826.0.1.3680043.8.498.7"
ROWS, COLUMNS = 4, 6
SMITH = "Smith"


def dicom_of_smith(number: int = 1, **more: object) -> bytes:
    """An image in whose header the patient's name stands wherever it could."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = XRayAngiographicImageStorage
    meta.MediaStorageSOPInstanceUID = UID(f"{ROOT}.{number}")
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.SourceApplicationEntityTitle = "SMITHWARD"
    dataset = FileDataset("", {}, file_meta=meta, preamble=b"Smith".ljust(128))
    dataset.SOPClassUID, dataset.SOPInstanceUID = XRayAngiographicImageStorage, f"{ROOT}.{number}"
    dataset.StudyInstanceUID, dataset.SeriesInstanceUID = f"{ROOT}.10", f"{ROOT}.11"
    for keyword in ("PatientName", "ReferringPhysicianName", "OperatorsName", "PerformingPhysicianName"):
        setattr(dataset, keyword, "Smith^Anna")
    for keyword in (
        "PatientID",
        "AccessionNumber",
        "StudyDescription",
        "InstitutionName",
        "StationName",
        "ImageComments",
    ):
        setattr(dataset, keyword, "SMITH-1")
    dataset.StudyDate = dataset.ContentDate = dataset.PatientBirthDate = "19620304"
    dataset.DeviceSerialNumber = "SMITH-SN"
    dataset.add_new((0x0029, 0x0010), "LO", "SMITH PRIVATE")
    dataset.add_new((0x0029, 0x1001), "LO", "Smith")
    other = Dataset()
    other.PatientID = "SMITH-2"
    dataset.OtherPatientIDsSequence = [other]
    dataset.Modality, dataset.Manufacturer, dataset.ImagerPixelSpacing = "XA", "Maker", [0.2, 0.2]
    dataset.DistanceSourceToDetector, dataset.Laterality = 1000.0, "L"
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns, dataset.PixelRepresentation = ROWS, COLUMNS, 0
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit = 16, 12, 11
    pixels = np.arange(ROWS * COLUMNS, dtype="<u2") * 100
    dataset.PixelData = (pixels | 0x8000).tobytes()  # an overlay in an unused bit
    for keyword, value in more.items():
        setattr(dataset, keyword, value)
    stream = io.BytesIO()
    dataset.save_as(stream, enforce_file_format=True)
    return stream.getvalue()


def case_of_smith(state_dir: Path) -> str:
    """A case over REST, with an approved plan, with a reason in Smith's name, and one real image; its id."""
    with open_room(state_dir) as room:
        case_id = room.open_case()
        room.approved_plan(case_id)
        step = {"step": "abandoned", "why": "Mrs Smith felt unwell", "done_by": "Dr Smith"}
        answer = room.post(f"/cases/{case_id}/steps", step)
        assert answer.status_code == 201, answer.text
        put_image(room.gateway.record, state_dir / "images", case_id, dicom_of_smith())
    return case_id


def put_image(record: CaseRecord, images: Path, case_id: str, content: bytes) -> None:
    """An image in the store, and the event of its receipt."""
    sha256 = sha256_of(content)
    file = stored_paths(images, sha256)[0]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    received = ImageReceived(sha256, f"{ROOT}.1", record._clock_ns(), 1, None, "another-store", 1)
    record.append(EventDraft(received, case_id, "imaging"))
