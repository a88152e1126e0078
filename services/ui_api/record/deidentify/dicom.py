"""A DICOM image without what identifies people in its header."""

import io
from typing import Final

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sequence import Sequence

from services.ui_api.record.deidentify.pseudonyms import Pseudonyms
from services.ui_api.record.deidentify.table import DICOM_RULES, Action, names_of

_KEPT: Final = names_of(DICOM_RULES, Action.KEEP)
_EMPTY: Final = names_of(DICOM_RULES, Action.EMPTY)
_UIDS: Final = names_of(DICOM_RULES, Action.REPLACE_UID)
_METHOD: Final = "distalock: PS3.15 E Basic Profile, only listed attributes kept"
# What the name says.
_BITS_OF_TWO_BYTES: Final = 16


class BurnedInText(Exception):
    """The header states that text is burned into the pixels, which nobody has looked at here."""


def deidentified_dicom(content: bytes, pseudonyms: Pseudonyms) -> bytes:
    """The image with the attributes that the table names, and what PS3.15 demands of one that was de-identified.

    Raises
    ------
    BurnedInText
        When its pixels hold text by its own header.
    """
    found = pydicom.dcmread(io.BytesIO(content))
    if found.get("BurnedInAnnotation") == "YES":
        raise BurnedInText
    cleaned = _listed(found, pseudonyms)
    for keyword in _EMPTY:
        setattr(cleaned, keyword, "")
    cleaned.PatientIdentityRemoved = "YES"
    cleaned.DeidentificationMethod = _METHOD
    cleaned.DeidentificationMethodCodeSequence = Sequence([_basic_profile()])
    cleaned.LongitudinalTemporalInformationModified = "REMOVED"
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = cleaned.SOPClassUID
    meta.MediaStorageSOPInstanceUID = cleaned.SOPInstanceUID
    meta.TransferSyntaxUID = found.file_meta.TransferSyntaxUID
    cleaned.file_meta = meta
    if not meta.TransferSyntaxUID.is_compressed:
        _drop_unused_bits(cleaned)
    stream = io.BytesIO()
    cleaned.save_as(stream, enforce_file_format=True)
    return stream.getvalue()


def _listed(found: Dataset, pseudonyms: Pseudonyms) -> Dataset:
    """Attributes that are kept, also inside of sequences that are kept, and UIDs of their own."""
    cleaned = Dataset()
    for element in found:
        if element.keyword in _UIDS:
            cleaned.add_new(element.tag, element.VR, pseudonyms.uid(str(element.value or "")))
        elif element.keyword in _KEPT:
            value = element.value
            if element.VR == "SQ":
                value = Sequence([_listed(item, pseudonyms) for item in value])
            cleaned.add_new(element.tag, element.VR, value)
    return cleaned


def _basic_profile() -> Dataset:
    code = Dataset()
    code.CodeValue = "113100"
    code.CodingSchemeDesignator = "DCM"
    code.CodeMeaning = "Basic Application Confidentiality Profile"
    return code


def _drop_unused_bits(dataset: Dataset) -> None:
    """Bits above the stored ones may hold an overlay of older C-arms, with text in it."""
    stored, allocated = dataset.BitsStored, dataset.BitsAllocated
    if allocated != _BITS_OF_TWO_BYTES or stored >= allocated or dataset.PixelRepresentation == 1:
        return
    byte_order = "<" if dataset.file_meta.TransferSyntaxUID.is_little_endian else ">"
    pixels = np.frombuffer(dataset.PixelData, dtype=f"{byte_order}u2")
    used = ((1 << stored) - 1) << (dataset.HighBit + 1 - stored)
    dataset.PixelData = (pixels & used).astype(pixels.dtype).tobytes()
