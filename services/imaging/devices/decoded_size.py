"""How large an image becomes when it is decoded, found before it is: a small file can ask for all memory there is.

Here is what the attributes state of all frames, and what they do not state: how far a deflated file grows, and the size
that a compressed picture states in its own header, which is what its decoder makes room for.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Final

from pydicom.dataset import Dataset
from pydicom.encaps import generate_frames
from pydicom.filereader import _read_file_meta_info
from pydicom.uid import DeflatedExplicitVRLittleEndian

from shared.errors import ImageUnreadable

# Chosen: one image of the longest side that is accepted, or 64 frames of 1024 x 1024. While a run is received and read,
# memory has four times its pixels of 16 bits, and 28 bytes for each pixel of a frame.
_MOST_VALUES: Final = 64 * 2**20
_MOST_FRAME_VALUES: Final = 16 * 2**20
# The largest run that is read, 64 Mi pixels of 16 bits, and 16 MiB of attributes.
MOST_FILE_BYTES: Final = 2**27 + 2**24
# A decoder may pad to whole blocks of 8 or 16 pixels.
_PADDING_PX: Final = 16
_PREAMBLE_BYTES: Final = 132
# Markers of JPEG, JPEG-LS and JPEG 2000 that are followed by the picture's size; C4, C8 and CC are others.
_JPEG_SIZES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC} | {0xF7}
_JPEG_WITHOUT_LENGTH: Final = frozenset(range(0xD0, 0xD9)) | {0x01}
_JPEG_SCAN: Final = 0xDA
_JPEG_2000: Final = b"\xff\x4f\xff\x51"
_JPEG_2000_BOX: Final = b"\x00\x00\x00\x0cjP  "


def require_bounded_file(content: bytes, source: str, most_bytes: int = MOST_FILE_BYTES) -> None:
    """Refuse a deflated DICOM file that grows beyond what an image can be; raises `ImageUnreadable`."""
    stream = BytesIO(content)
    stream.seek(_PREAMBLE_BYTES)
    if _read_file_meta_info(stream).get("TransferSyntaxUID") != DeflatedExplicitVRLittleEndian:
        return
    grown = zlib.decompressobj(-zlib.MAX_WBITS).decompress(content[stream.tell() :], most_bytes + 1)
    if len(grown) > most_bytes:
        raise ImageUnreadable(
            f"{source}: the deflated file of {len(content)} bytes grows beyond {most_bytes} bytes; send it as it is"
        )


def stated_frames(dataset: Dataset) -> int:
    """How many frames an object states; one where it states nothing."""
    return int(dataset.get("NumberOfFrames", 1) or 1)


def require_room(dataset: Dataset, source: str) -> None:
    """Refuse an image or a run that takes too much memory, by what it states; raises `ImageUnreadable`."""
    frames, columns, rows = stated_frames(dataset), int(dataset.Columns), int(dataset.Rows)
    frame = rows * columns * int(dataset.get("SamplesPerPixel", 1) or 1)
    if not 0 < frames * frame <= _MOST_VALUES:
        raise ImageUnreadable(
            f"{source}: {frames} frames of {columns} x {rows} are {frames * frame} values "
            f"(1 to {_MOST_VALUES}); send {'grey images' if frames == 1 else 'a shorter run or single images'}"
        )
    if frames > 1 and frame > _MOST_FRAME_VALUES:
        raise ImageUnreadable(
            f"{source}: a frame of a run, of {columns} x {rows}, has {frame} values (at most {_MOST_FRAME_VALUES}); "
            "send single images"
        )


def require_stated_size(dataset: Dataset, source: str) -> None:
    """Refuse a compressed picture that is larger than the object's attributes state; raises `ImageUnreadable`."""
    syntax = dataset.file_meta.TransferSyntaxUID
    if not syntax.is_encapsulated:
        return
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    for frame in generate_frames(dataset.PixelData, number_of_frames=stated_frames(dataset)):
        size = coded_size(frame)
        if size is not None and (size[0] > rows + _PADDING_PX or size[1] > columns + _PADDING_PX):
            raise ImageUnreadable(
                f"{source}: the compressed picture is of {size[1]} x {size[0]} pixels, the object states {columns} x "
                f"{rows}; send it again, uncompressed"
            )


def coded_size(frame: bytes) -> tuple[int, int] | None:
    """Rows and columns that a JPEG, JPEG-LS or JPEG 2000 picture states; None for another coding."""
    start = frame.find(_JPEG_2000) if frame.startswith((_JPEG_2000_BOX, _JPEG_2000)) else -1
    if start >= 0:
        right, lower, left, upper = struct.unpack_from(">4I", frame, start + 8)
        return lower - upper, right - left
    if not frame.startswith(b"\xff\xd8"):
        return None
    sizes = list(_jpeg_sizes(frame))
    return (max(rows for rows, _ in sizes), max(columns for _, columns in sizes)) if sizes else None


def _jpeg_sizes(frame: bytes) -> Iterator[tuple[int, int]]:
    """From marker to marker up to the first scan."""
    at = 2
    while at + 9 <= len(frame) and frame[at] == 0xFF and frame[at + 1] != _JPEG_SCAN:
        marker = frame[at + 1]
        if marker in _JPEG_SIZES:
            rows, columns = struct.unpack_from(">2H", frame, at + 5)
            yield rows, columns
        at += 2 if marker in _JPEG_WITHOUT_LENGTH else 2 + struct.unpack_from(">H", frame, at + 2)[0]
