"""Small files that would become large: refused before anything is decoded."""

import struct
import zlib
from io import BytesIO

import cv2
import numpy as np
import pytest
from pydicom import dcmwrite
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate
from pydicom.uid import DeflatedExplicitVRLittleEndian, JPEGBaseline8Bit

from services.imaging.devices.decoded_size import coded_size, require_bounded_file, require_stated_size
from services.imaging.devices.dicom_file import read_dicom
from services.imaging.devices.image_file import read_image
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, grey_ramp


def deflated(dataset: Dataset) -> bytes:
    dataset.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    buffer = BytesIO()
    dcmwrite(buffer, dataset, enforce_file_format=True)
    return buffer.getvalue()


def test_a_deflated_image_is_read() -> None:
    assert (read_dicom(deflated(dataset_of(grey_ramp())), "C-arm").pixels == grey_ramp()).all()


@pytest.mark.requirement("IMG-03")
def test_a_deflated_file_that_grows_without_end_is_refused() -> None:
    """A thousand times its size, and only a little more than allowed is ever made of it."""
    start = deflated(dataset_of(grey_ramp()))
    meta = start[: 144 + struct.unpack_from("<I", start, 140)[0]]
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    bomb = meta + packer.compress(bytes(64 * 2**20)) + packer.flush()
    assert len(bomb) < 2**17
    with pytest.raises(ImageUnreadable, match=f"C-arm: the deflated file of {len(bomb)} bytes grows beyond 1048576"):
        require_bounded_file(bomb, "C-arm", 2**20)


@pytest.mark.parametrize("ending", [".jpg", ".jp2"])
def test_the_coded_size_is_found(ending: str) -> None:
    coded, picture = cv2.imencode(ending, np.zeros((48, 80), np.uint8))
    assert coded
    assert coded_size(picture.tobytes()) == (48, 80)


def test_other_codings_have_no_size() -> None:
    assert coded_size(b"\x01\x00\x00\x00") is None
    assert coded_size(b"\xff\xd8\xff") is None


def test_a_picture_larger_than_stated_is_refused() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.file_meta.TransferSyntaxUID = JPEGBaseline8Bit
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    picture = bytearray(cv2.imencode(".jpg", np.zeros((rows, columns), np.uint8))[1].tobytes())
    dataset.PixelData = encapsulate([bytes(picture)])
    require_stated_size(dataset, "C-arm")
    at = picture.index(b"\xff\xc0")
    picture[at + 5 : at + 9] = struct.pack(">2H", 65000, 65000)
    dataset.PixelData = encapsulate([bytes(picture)])
    with pytest.raises(ImageUnreadable, match=f"of 65000 x 65000 pixels, the object states {columns} x {rows}"):
        require_stated_size(dataset, "C-arm")


@pytest.mark.requirement("IMG-03")
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tiff_that_states_a_large_size_is_refused(order: str) -> None:
    mark = {"<": b"II", ">": b"MM"}[order]
    entries = struct.pack(f"{order}HHII", 256, 4, 1, 30000) + struct.pack(f"{order}HHIHH", 257, 3, 1, 30001, 0)
    content = mark + struct.pack(f"{order}HIH", 42, 8, 2) + entries + bytes(4)
    with pytest.raises(ImageUnreadable, match="30000 x 30001 pixels"):
        read_image(content, "scan.tif")
