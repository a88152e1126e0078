import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.devices.image_file import read_image
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import grey_ramp

LACKING = r"lacks its header or its end mark \(damaged or truncated\); send it again"


def encoded(pixels: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32], kind: str) -> bytes:
    return bytes(cv2.imencode(kind, pixels)[1])


@pytest.mark.parametrize("kind", [".png", ".tiff"])
@pytest.mark.parametrize("bits", [8, 16])
def test_grey_files_are_read_and_become_dicom(kind: str, bits: int) -> None:
    pixels = (grey_ramp() // 20).astype(np.uint8) if bits == 8 else grey_ramp()
    image = read_image(encoded(pixels, kind), "file")
    assert (image.pixels == pixels).all()
    assert image.bits_stored == bits
    again = read_image(image.dicom, "the same as DICOM")
    assert (again.pixels == pixels).all()
    assert again.sop_instance_uid == image.sop_instance_uid


def test_a_grey_picture_stored_in_colours_is_read() -> None:
    pixels = np.repeat((grey_ramp() // 20).astype(np.uint8)[:, :, None], 3, axis=2)
    assert (read_image(encoded(pixels, ".png"), "file").pixels == pixels[..., 0]).all()


def test_a_coloured_picture_is_refused() -> None:
    pixels = np.zeros((5, 5, 3), np.uint8)
    pixels[..., 1] = 9
    with pytest.raises(ImageUnreadable, match="3 colours; needed is a grey image"):
        read_image(encoded(pixels, ".png"), "file")


def test_a_floating_point_tiff_is_refused() -> None:
    with pytest.raises(ImageUnreadable, match="grey values are float32"):
        read_image(encoded(np.ones((5, 5), np.float32), ".tiff"), "file")


@pytest.mark.parametrize("content", [b"", b"hello", b"GIF89a" + b"\0" * 200, b"{}" * 100])
def test_what_is_not_an_image_is_refused(content: bytes) -> None:
    with pytest.raises(
        ImageUnreadable, match=f"notes.txt: {len(content)} bytes that are not an image; needed is a PNG"
    ):
        read_image(content, "notes.txt")


def test_a_truncated_png_is_refused() -> None:
    content = encoded(np.random.default_rng(1).integers(0, 255, (64, 64), np.uint8), ".png")
    with pytest.raises(ImageUnreadable, match=LACKING):
        read_image(content[: len(content) // 2], "file")


@pytest.mark.parametrize("length", [0, 4000, 2**31, 2**32 - 1])
def test_a_png_whose_chunks_claim_another_length_is_refused_before_it_is_decoded(length: int) -> None:
    content = bytearray(encoded(np.zeros((64, 64), np.uint8), ".png"))
    second = 8 + 12 + 13
    content[second : second + 4] = length.to_bytes(4, "big")
    with pytest.raises(ImageUnreadable, match=LACKING):
        read_image(bytes(content), "file")


@pytest.mark.requirement("IMG-03")
def test_a_png_that_claims_to_be_huge_is_refused_before_it_is_decoded() -> None:
    content = bytearray(encoded(np.zeros((64, 64), np.uint8), ".png"))
    content[16:20] = (40_000).to_bytes(4, "big")
    with pytest.raises(ImageUnreadable, match="file: 40000 x 64 pixels \\(at most 8192 each way\\); send an X-ray"):
        read_image(bytes(content), "file")


def test_a_png_of_a_million_empty_chunks_is_walked_through_once() -> None:
    """To look through all names at every chunk would take hours."""
    whole = encoded(np.zeros((64, 64), np.uint8), ".png")
    header, chunk = whole[: 8 + 12 + 13], bytes(4) + b"tEXt" + bytes(4)
    with pytest.raises(ImageUnreadable, match=LACKING):
        read_image(header + 1_000_000 * chunk, "file")


def test_a_png_without_a_header_is_refused() -> None:
    whole = encoded(np.zeros((64, 64), np.uint8), ".png")
    with pytest.raises(ImageUnreadable, match=LACKING):
        read_image(whole[:8] + whole[8 + 12 + 13 :], "file")


def test_a_damaged_tiff_is_refused() -> None:
    content = encoded(np.random.default_rng(1).integers(0, 255, (64, 64), np.uint8), ".tiff")
    with pytest.raises(ImageUnreadable, match="damaged or truncated"):
        read_image(content[:40], "file")
