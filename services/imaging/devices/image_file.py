"""Read an image file: PNG or TIFF of 8 or 16 bits, or DICOM.

The DICOM library is imported when a DICOM file is read or made: it takes as long as calibrating an image.
"""

from typing import Literal

import cv2
import numpy as np

from services.imaging.devices.received_image import LONGEST_SIDE, Acquisition, GreyPixels, ImageContent, ReceivedImage
from shared.errors import ImageUnreadable

_PNG = b"\x89PNG\r\n\x1a\n"
# Of the standards: a PNG chunk's length, name and checksum; DICOM's preamble before its mark (PS3.10).
_PNG_OVERHEAD = 12
_TIFF = (b"II*\x00", b"MM\x00*")
# Tags of width and height, and the type of a value of two bytes.
_TIFF_SIDES, _TIFF_SHORT = (256, 257), 3
_DICOM_AT, _DICOM = 128, b"DICM"
_KINDS = "a PNG or TIFF of 8 or 16 bits, or a DICOM file"


def is_dicom(content: bytes) -> bool:
    """Whether a file carries DICOM's mark."""
    return content[_DICOM_AT : _DICOM_AT + len(_DICOM)] == _DICOM


def read_image(content: bytes, source: str) -> ReceivedImage:
    """Read an image from a file's content.

    Parameters
    ----------
    content
        The whole file.
    source
        Name of the file, for the error's sentence.

    Returns
    -------
    ReceivedImage
        Normalised so that darker is denser where the file is tagged; PNG and TIFF carry no such tag and are taken to be
        so.

    Raises
    ------
    ImageUnreadable
        With one sentence: what was found, what is needed.
    """
    from services.imaging.devices.dicom_file import dicom_of_pixels, read_dicom

    if is_dicom(content):
        return read_dicom(content, source)
    pixels = _read_plain(content, source)
    dicom, uid = dicom_of_pixels(pixels)
    return ReceivedImage(pixels.astype(np.float32), 8 * pixels.dtype.itemsize, dicom, uid, Acquisition())


def read_content(content: bytes, source: str) -> ImageContent:
    """Read what can be measured of an image; the same without making a DICOM file of it."""
    if not is_dicom(content):
        return ImageContent(_read_plain(content, source).astype(np.float32), Acquisition())
    received = read_image(content, source)
    return ImageContent(received.pixels, received.acquisition)


def _read_plain(content: bytes, source: str) -> GreyPixels:
    """Grey values of a PNG or TIFF, shape (rows, columns)."""
    if content.startswith(_PNG):
        _require_whole_png(content, source)
    elif content.startswith(_TIFF):
        _require_size(*_tiff_size(content), source)
    else:
        raise ImageUnreadable(f"{source}: {len(content)} bytes that are not an image; needed is {_KINDS}")
    return _decoded(content, source)


def _require_whole_png(content: bytes, source: str) -> None:
    """Walk from chunk to chunk to the end mark; the decoder would believe any length and any size, for many seconds."""
    at, first, last = len(_PNG), content[len(_PNG) + 4 : len(_PNG) + 8], b""
    while at + _PNG_OVERHEAD <= len(content) and last != b"IEND":
        length, last = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        at += _PNG_OVERHEAD + length
    if first != b"IHDR" or last != b"IEND" or at > len(content):
        raise ImageUnreadable(
            f"{source}: the PNG of {len(content)} bytes lacks its header or its end mark (damaged or truncated); "
            "send it again"
        )
    width, height = (int.from_bytes(content[k : k + 4], "big") for k in (len(_PNG) + 8, len(_PNG) + 12))
    _require_size(width, height, source)


def _tiff_size(content: bytes) -> tuple[int, int]:
    """Width and height that the first directory of a TIFF states; zero where it states none."""
    order: Literal["little", "big"] = "little" if content.startswith(b"II") else "big"
    at = int.from_bytes(content[4:8], order)
    sides = dict.fromkeys(_TIFF_SIDES, 0)
    for entry in range(at + 2, at + 2 + 12 * int.from_bytes(content[at : at + 2], order), 12):
        tag, kind = (int.from_bytes(content[k : k + 2], order) for k in (entry, entry + 2))
        if tag in sides:
            value = content[entry + 8 : entry + (10 if kind == _TIFF_SHORT else 12)]
            sides[tag] = max(sides[tag], int.from_bytes(value, order))
    return sides[_TIFF_SIDES[0]], sides[_TIFF_SIDES[1]]


def _require_size(width: int, height: int, source: str) -> None:
    if max(width, height) > LONGEST_SIDE:
        raise ImageUnreadable(
            f"{source}: {width} x {height} pixels (at most {LONGEST_SIDE} each way); send an X-ray image"
        )


def _decoded(content: bytes, source: str) -> GreyPixels:
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise ImageUnreadable(f"{source}: the image cannot be decoded: it is damaged or truncated; send it again")
    if image.ndim == 3 and image.shape[2] >= 3 and bool(np.all(image[..., :3] == image[..., :1])):
        image = image[..., 0]
    if image.ndim != 2:
        raise ImageUnreadable(f"{source}: the image has {image.shape[2]} colours; needed is a grey image: {_KINDS}")
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image, dtype=np.uint8)
    if image.dtype == np.uint16:
        return np.ascontiguousarray(image, dtype=np.uint16)
    raise ImageUnreadable(f"{source}: the grey values are {image.dtype}; needed is {_KINDS}")
