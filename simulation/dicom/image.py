"""The DICOM image that the C-arm makes of a shot."""

import hashlib
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO

import numpy as np
from pydicom import dcmwrite
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, XRayAngiographicImageStorage, generate_uid

from simulation.render.display import Grey
from simulation.scenario.c_arm_angles import CArmAngles
from simulation.scenario.values import Scenario

MANUFACTURER = "distalock virtual operating room"
MODEL = "simulated C-arm"


@dataclass(frozen=True, slots=True)
class DicomShot:
    """One image as a DICOM file.

    Attributes
    ----------
    dataset
        With its file meta information.
    file
        The encoded file.
    file_sha256, pixel_sha256
        Of the whole file, and of the pixel data alone.
    """

    dataset: Dataset
    file: bytes
    sop_instance_uid: str
    file_sha256: str
    pixel_sha256: str


@dataclass(frozen=True, slots=True)
class Acquisition:
    """What identifies a shot among others."""

    taken_at: datetime
    study_uid: str
    series_uid: str
    number: int


def dicom_shot(scenario: Scenario, angles: CArmAngles, pixels: Grey, acquisition: Acquisition) -> DicomShot:
    """Wrap an image into an X-ray angiographic image, with the C-arm's nominal geometry."""
    dataset = Dataset()
    dataset.file_meta = _file_meta()
    dataset.SOPClassUID = XRayAngiographicImageStorage
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID
    _patient(dataset, scenario, acquisition)
    _equipment(dataset, scenario, angles)
    _moment(dataset, acquisition)
    _pixels(dataset, scenario, pixels)
    buffer = BytesIO()
    dcmwrite(buffer, dataset, enforce_file_format=True)
    file = buffer.getvalue()
    return DicomShot(
        dataset,
        file,
        str(dataset.SOPInstanceUID),
        hashlib.sha256(file).hexdigest(),
        hashlib.sha256(dataset.PixelData).hexdigest(),
    )


def _file_meta() -> FileMetaDataset:
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = XRayAngiographicImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    return meta


def _patient(dataset: Dataset, scenario: Scenario, acquisition: Acquisition) -> None:
    dataset.PatientName = "SIMULATED^PATIENT"
    dataset.PatientID = f"SIMULATED-{scenario.seed}"
    dataset.PatientBirthDate = ""
    dataset.PatientSex = ""
    dataset.StudyInstanceUID = acquisition.study_uid
    dataset.SeriesInstanceUID = acquisition.series_uid
    dataset.StudyID = "1"
    dataset.SeriesNumber = 1
    dataset.AccessionNumber = ""
    dataset.ReferringPhysicianName = ""
    dataset.Laterality = scenario.side.value[0].upper()
    dataset.BodyPartExamined = "LEG"


def _equipment(dataset: Dataset, scenario: Scenario, angles: CArmAngles) -> None:
    dataset.Modality = "XA"
    dataset.Manufacturer = MANUFACTURER
    dataset.ManufacturerModelName = MODEL
    dataset.StationName = "VIRTUAL-OR"
    dataset.ImagerPixelSpacing = [scenario.c_arm.nominal_pixel_mm] * 2
    dataset.DistanceSourceToDetector = scenario.c_arm.nominal_source_to_detector_mm
    dataset.PositionerMotion = "STATIC"
    dataset.PositionerPrimaryAngle = round(angles.orbital_deg, 1)
    dataset.PositionerSecondaryAngle = round(angles.angular_deg, 1)
    dataset.KVP = round(scenario.exposure.tube_voltage_kv)
    dataset.RadiationSetting = "SC"


def _moment(dataset: Dataset, acquisition: Acquisition) -> None:
    taken_at = acquisition.taken_at
    date, time = taken_at.strftime("%Y%m%d"), taken_at.strftime("%H%M%S.%f")
    for kind in ("Study", "Series", "Acquisition", "Content"):
        setattr(dataset, f"{kind}Date", date)
        setattr(dataset, f"{kind}Time", time)
    dataset.InstanceNumber = acquisition.number
    dataset.AcquisitionNumber = acquisition.number
    dataset.ImageType = ["ORIGINAL", "PRIMARY", "SINGLE PLANE"]


def _pixels(dataset: Dataset, scenario: Scenario, pixels: Grey) -> None:
    bits = scenario.display.bits
    stored = pixels if bits == 8 else pixels >> (16 - bits)
    dataset.Rows, dataset.Columns = pixels.shape
    dataset.SamplesPerPixel = 1
    dataset.PhotometricInterpretation = "MONOCHROME2"
    dataset.PixelIntensityRelationship = "DISP"
    dataset.BitsAllocated = 8 if bits == 8 else 16
    dataset.BitsStored, dataset.HighBit = bits, bits - 1
    dataset.PixelRepresentation = 0
    dataset.PixelData = np.ascontiguousarray(stored).tobytes()
