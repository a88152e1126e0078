"""Read one DICOM image, and make one from plain pixels.

Polarity: PixelIntensityRelationshipSign (0028,1041) says whether low stored values mean little X-ray (+1: darker is
denser) or much (-1). Without it the photometric interpretation decides how values look: MONOCHROME1 shows high values
dark.
"""

import hashlib
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from pydicom import dcmread, dcmwrite
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.errors import InvalidDicomError
from pydicom.uid import ExplicitVRLittleEndian, SecondaryCaptureImageStorage, generate_uid

from services.imaging.devices.received_image import Acquisition, ReceivedImage
from shared.errors import ImageUnreadable

GreyPixels = NDArray[np.uint8] | NDArray[np.uint16]

_MAGIC_AT = 128
_MAGIC = b"DICM"
_GREY = ("MONOCHROME1", "MONOCHROME2")
_REPORTED = (OSError, ValueError, AttributeError, KeyError, TypeError, NotImplementedError, RuntimeError, IndexError)


def is_dicom(content: bytes) -> bool:
    """Whether a file carries DICOM's mark."""
    return content[_MAGIC_AT : _MAGIC_AT + len(_MAGIC)] == _MAGIC


def read_dicom(content: bytes, source: str) -> ReceivedImage:
    """Read one grey DICOM image.

    Parameters
    ----------
    content
        The whole file.
    source
        Name of the file or sender, for the error's sentence.

    Raises
    ------
    ImageUnreadable
        When it is truncated, not one grey frame, or compressed in a way that cannot be decoded.
    """
    try:
        dataset = dcmread(BytesIO(content))
        _require_one_grey_frame(dataset, source)
        stored = np.asarray(dataset.pixel_array)
    except ImageUnreadable:
        raise
    except (InvalidDicomError, *_REPORTED) as error:
        raise ImageUnreadable(
            f"{source}: the DICOM file of {len(content)} bytes is damaged, truncated or compressed in an unknown way "
            f"({_first_line(error)}); send it again, uncompressed"
        ) from None
    return ReceivedImage(
        pixels=_dark_is_dense(dataset, stored),
        bits_stored=int(dataset.BitsStored),
        dicom=content,
        sop_instance_uid=str(dataset.SOPInstanceUID),
        acquisition=_acquisition(dataset),
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]


def _require_one_grey_frame(dataset: Dataset, source: str) -> None:
    if "SOPInstanceUID" not in dataset or "PixelData" not in dataset:
        raise ImageUnreadable(
            f"{source}: the DICOM object has no pixels or no SOP Instance UID: it is truncated or not an image; "
            "send an X-ray image"
        )
    photometric = str(dataset.get("PhotometricInterpretation", "missing"))
    if photometric not in _GREY:
        raise ImageUnreadable(
            f"{source}: the photometric interpretation is {photometric}; needed is {' or '.join(_GREY)}"
        )
    frames = int(dataset.get("NumberOfFrames", 1) or 1)
    if frames != 1:
        raise ImageUnreadable(f"{source}: the DICOM object holds {frames} frames; send single images (1 frame)")


def _dark_is_dense(dataset: Dataset, stored: NDArray[np.generic]) -> NDArray[np.float32]:
    """Grey values, reversed when the tags say that bright is dense, shape (rows, columns)."""
    values = stored.astype(np.float32)
    sign = dataset.get("PixelIntensityRelationshipSign")
    if sign is None:
        slope = float(dataset.get("RescaleSlope", 1.0) or 1.0)
        inverted = (dataset.PhotometricInterpretation == "MONOCHROME1") != (slope < 0.0)
    else:
        inverted = int(sign) < 0
    if not inverted:
        return values
    if int(dataset.get("PixelRepresentation", 0)) == 1:
        return -values
    return np.float32(2 ** int(dataset.BitsStored) - 1) - values


def _acquisition(dataset: Dataset) -> Acquisition:
    spacing = dataset.get("ImagerPixelSpacing")
    return Acquisition(
        manufacturer=str(dataset.get("Manufacturer", "") or ""),
        model_name=str(dataset.get("ManufacturerModelName", "") or ""),
        source_to_detector_mm=_positive(dataset.get("DistanceSourceToDetector")),
        pixel_mm=_positive(spacing[0]) if spacing else None,
        positioner_primary_angle_deg=_number(dataset.get("PositionerPrimaryAngle")),
        positioner_secondary_angle_deg=_number(dataset.get("PositionerSecondaryAngle")),
    )


def _number(value: object) -> float | None:
    """A DICOM decimal, or None when it is missing, empty or not finite."""
    try:
        number = float(str(value))
    except ValueError:
        return None
    return number if np.isfinite(number) else None


def _positive(value: object) -> float | None:
    number = _number(value)
    return number if number is not None and number > 0.0 else None


def dicom_of_pixels(pixels: GreyPixels) -> tuple[bytes, str]:
    """Make a DICOM object (secondary capture) of grey values, shape (rows, columns).

    Returns
    -------
    tuple
        The file, and its SOP Instance UID. The same pixels always give the same file: it holds no time and its
        identifiers are derived from the pixels.
    """
    digest = hashlib.sha256(pixels.tobytes() + str(pixels.shape).encode()).hexdigest()
    uid = generate_uid(entropy_srcs=["distalock", digest])
    bits = 8 * pixels.dtype.itemsize
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = SecondaryCaptureImageStorage
    meta.MediaStorageSOPInstanceUID = uid
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset = Dataset()
    dataset.file_meta = meta
    dataset.SOPClassUID = SecondaryCaptureImageStorage
    dataset.SOPInstanceUID = uid
    dataset.StudyInstanceUID = str(generate_uid(entropy_srcs=["distalock", "study", digest]))
    dataset.SeriesInstanceUID = str(generate_uid(entropy_srcs=["distalock", "series", digest]))
    dataset.Modality, dataset.ConversionType = "OT", "WSD"
    dataset.PatientName, dataset.PatientID = "", ""
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns = pixels.shape
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = bits, bits, bits - 1, 0
    content = pixels.tobytes()
    dataset.add_new("PixelData", "OW" if bits == 16 else "OB", content + b"\0" * (len(content) % 2))
    buffer = BytesIO()
    dcmwrite(buffer, dataset, enforce_file_format=True)
    return buffer.getvalue(), str(uid)
