"""Read one DICOM image, and make one from plain pixels.

A run of frames is averaged from its last motion to its end. What the grey values mean is in
`dicom_pixels`.
"""

import hashlib
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydicom import dcmread, dcmwrite
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.errors import BytesLengthException, InvalidDicomError
from pydicom.uid import ExplicitVRLittleEndian, SecondaryCaptureImageStorage, generate_uid

from services.imaging.core.still_frames import MotionLimits, last_still_run
from services.imaging.core.tuning import STILL_FRAMES
from services.imaging.devices.decoded_size import (
    require_bounded_file,
    require_room,
    require_stated_size,
    stated_frames,
)
from services.imaging.devices.dicom_pixels import grey_frames
from services.imaging.devices.received_image import (
    BOUNDS_MM,
    LONGEST_SIDE,
    Acquisition,
    GreyPixels,
    HeaderValue,
    ReceivedImage,
    UnusableValue,
)
from shared.errors import ImageUnreadable

# What pydicom and its decoders raise on damaged files; the list is what fuzzing found.
_REPORTED = (
    AttributeError,
    BytesLengthException,
    IndexError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    TypeError,
    ValueError,
    EOFError,
    struct.error,
    zlib.error,
)
_MOST_BITS = 16
# Pixels that are not square, or two focal spots of which one was used: within rounding they are the same.
_EQUAL_VALUES = 1.01


def read_dicom(content: bytes, source: str) -> ReceivedImage:
    """Read one grey DICOM image, or a run of frames of a still scene.

    Parameters
    ----------
    content
        The whole file.
    source
        Name of the file or sender, for the error's sentence.

    Raises
    ------
    ImageUnreadable
        When it is truncated, not grey, moving at its end, or compressed in a way that cannot be decoded.
    """
    try:
        require_bounded_file(content, source)
        return _received(dcmread(BytesIO(content)), content, source)
    except ImageUnreadable:
        raise
    except (InvalidDicomError, *_REPORTED) as error:
        raise ImageUnreadable(
            f"{source}: the DICOM file of {len(content)} bytes is damaged, truncated or compressed in an unknown way "
            f"({_first_line(error)}); send it again, uncompressed"
        ) from None


def _received(dataset: Dataset, content: bytes, source: str) -> ReceivedImage:
    _require_pixels(dataset, source)
    require_stated_size(dataset, source)
    return ReceivedImage(
        pixels=_still(grey_frames(dataset, source), stated_frames(dataset), source),
        bits_stored=int(dataset.BitsStored),
        dicom=content,
        sop_instance_uid=str(dataset.SOPInstanceUID),
        acquisition=_acquisition(dataset),
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]


def _require_pixels(dataset: Dataset, source: str) -> None:
    if "SOPInstanceUID" not in dataset or "PixelData" not in dataset:
        raise ImageUnreadable(
            f"{source}: the DICOM object has no pixels or no SOP Instance UID: it is truncated or not an image; "
            "send an X-ray image"
        )
    bits, allocated = int(dataset.BitsStored), int(dataset.BitsAllocated)
    longest = max(int(dataset.Rows), int(dataset.Columns))
    if not 0 < bits <= _MOST_BITS or allocated > _MOST_BITS or longest > LONGEST_SIDE:
        raise ImageUnreadable(
            f"{source}: {dataset.Columns} x {dataset.Rows} pixels of {bits} bits in {allocated} (at most "
            f"{LONGEST_SIDE} each way, 1 to {_MOST_BITS} bits); send an X-ray image"
        )
    require_room(dataset, source)


def _still(frames: Iterator[NDArray[np.float32]], count: int, source: str) -> NDArray[np.float32]:
    """The mean of the frames after the last motion, shape (rows, columns), of as many as are stated.

    The image is bound to where the robot stands when it arrives: frames from before a motion show another place.

    Raises
    ------
    ImageUnreadable
        When too few frames stand still at the end.
    """
    if count == 1:
        return next(frames)
    limits = MotionLimits(least_frames=min(count, STILL_FRAMES.least_frames))
    run = last_still_run(frames, limits)
    still = 0 if run is None else run.frames
    if run is None or still < limits.least_frames:
        raise ImageUnreadable(
            f"{source}: a run of {count} frames ends with {still} after its last motion (at least "
            f"{limits.least_frames}); hold leg and C-arm still until the run ends and take another run"
        )
    return run.mean


_SIDES: Final[Mapping[str, Literal["left", "right"]]] = {"L": "left", "R": "right"}


def _acquisition(dataset: Dataset) -> Acquisition:
    stated = {
        HeaderValue.SOURCE_TO_DETECTOR: _numbers(dataset.get("DistanceSourceToDetector")),
        HeaderValue.PIXEL: _numbers(dataset.get("ImagerPixelSpacing")),
        HeaderValue.FOCAL_SPOT: _numbers(dataset.get("FocalSpots")),
    }
    lengths = {attribute: _length_mm(attribute, values) for attribute, values in stated.items()}
    usable = {attribute: length for attribute, length in lengths.items() if isinstance(length, float)}
    return Acquisition(
        manufacturer=str(dataset.get("Manufacturer", "") or ""),
        model_name=str(dataset.get("ManufacturerModelName", "") or ""),
        source_to_detector_mm=usable.get(HeaderValue.SOURCE_TO_DETECTOR),
        pixel_mm=usable.get(HeaderValue.PIXEL),
        positioner_primary_angle_deg=_number(dataset.get("PositionerPrimaryAngle")),
        positioner_secondary_angle_deg=_number(dataset.get("PositionerSecondaryAngle")),
        focal_spot_mm=usable.get(HeaderValue.FOCAL_SPOT),
        laterality=_laterality(dataset),
        unusable=tuple(length for length in lengths.values() if isinstance(length, UnusableValue)),
    )


def _laterality(dataset: Dataset) -> Literal["left", "right"] | None:
    """The side that the file states, of the image before that of the series; None for both, unpaired and nothing."""
    stated = str(dataset.get("ImageLaterality") or dataset.get("Laterality") or "").strip().upper()
    return _SIDES.get(stated)


def _numbers(value: object) -> tuple[float, ...]:
    """The numbers of an attribute, which may have one value, several or none; what is no number is NaN."""
    if value is None or value == "":
        return ()
    values = value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
    return tuple(_as_float(one) for one in values)


def _as_float(value: object) -> float:
    try:
        return float(str(value))
    except ValueError:
        return float("nan")


def _length_mm(attribute: HeaderValue, values: tuple[float, ...]) -> float | UnusableValue | None:
    """A length that the measurement uses; zero is how some devices write that a value is unknown."""
    if not any(values):
        return None
    least, most = BOUNDS_MM[attribute]
    quoted = " and ".join(f"{value:g}" for value in values)
    if not all(least <= value <= most for value in values):
        return UnusableValue(attribute, f"{attribute.value} is {quoted} mm ({least:g} to {most:g})")
    if max(values) > _EQUAL_VALUES * min(values):
        return UnusableValue(attribute, f"{attribute.value} is {quoted} mm (one value, or equal ones)")
    return values[0]


def _number(value: object) -> float | None:
    """A DICOM decimal, or None when it is missing, empty or not finite."""
    try:
        number = float(str(value))
    except ValueError:
        return None
    return number if np.isfinite(number) else None


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
