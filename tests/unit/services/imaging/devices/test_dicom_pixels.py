"""What stored values mean: checked on objects with two values, of which the first is little X-ray."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate
from pydicom.pixels.utils import set_pixel_data
from pydicom.uid import JPEGBaseline8Bit, JPEGLosslessSV1, RLELossless

from services.imaging.devices.dicom_file import read_dicom
from services.imaging.devices.dicom_receiver import decodable_syntaxes
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, file_of

VALUES = np.array([[100, 3000]], dtype=np.uint16)


def read(dataset: Dataset) -> NDArray[np.float32]:
    return read_dicom(file_of(dataset), "test").pixels


def is_reversed(dataset: Dataset) -> bool:
    first, second = read(dataset)[0]
    return bool(first > second)


@pytest.mark.parametrize(
    ("tags", "inverted"),
    [
        ({}, False),
        ({"PhotometricInterpretation": "MONOCHROME1"}, True),
        ({"RescaleSlope": "-1", "RescaleIntercept": "0"}, True),
        ({"PhotometricInterpretation": "MONOCHROME1", "RescaleSlope": "-2", "RescaleIntercept": "0"}, False),
        ({"PresentationLUTShape": "INVERSE"}, True),
        ({"PresentationLUTShape": "IDENTITY"}, False),
        ({"PresentationLUTShape": "INVERSE", "PhotometricInterpretation": "MONOCHROME1"}, True),
        ({"PresentationLUTShape": "INVERSE", "PhotometricInterpretation": "MONOCHROME1", "RescaleSlope": "-1"}, False),
        ({"PixelIntensityRelationshipSign": 1, "PhotometricInterpretation": "MONOCHROME1"}, False),
        ({"PixelIntensityRelationshipSign": -1}, True),
        ({"WindowCenter": "50", "WindowWidth": "10"}, False),
    ],
)
def test_polarity(tags: dict[str, object], inverted: bool) -> None:  # noqa: FBT001
    dataset = dataset_of(VALUES)
    for name, value in tags.items():
        setattr(dataset, name, value)
    assert is_reversed(dataset) is inverted


@pytest.mark.parametrize(("table", "inverted"), [([0, 10, 20], False), ([20, 10, 0], True)])
def test_a_modality_lut_that_falls_turns_the_polarity(table: list[int], inverted: bool) -> None:  # noqa: FBT001
    dataset, entry = dataset_of(VALUES), Dataset()
    entry.LUTDescriptor, entry.ModalityLUTType, entry.LUTData = [3, 0, 16], "US", np.array(table, np.uint16).tobytes()
    dataset.ModalityLUTSequence = [entry]
    assert is_reversed(dataset) is inverted


def test_an_overlay_in_unused_bits_is_no_part_of_the_values() -> None:
    dataset = dataset_of(VALUES | np.uint16(0x8000))
    dataset.BitsStored, dataset.HighBit = 12, 11
    assert (read(dataset) == VALUES).all()


def test_negative_values_keep_their_sign() -> None:
    dataset = dataset_of(np.array([[0x0FFF, 5]], dtype=np.uint16))
    dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 12, 11, 1
    assert read(dataset).tolist() == [[-1.0, 5.0]]


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("high", "signed"), [(15, False), (15, True), (13, False), (13, True), (11, True)])
def test_values_are_read_from_below_the_high_bit(high: int, signed: bool, compressed: bool) -> None:  # noqa: FBT001
    values = np.array([[100, -5 if signed else 4000]])
    placed = ((values & 0xFFF) << (high - 11)) | (0x8000 if high < 15 else 0x0008)
    dataset = dataset_of(placed.astype(np.uint16))
    dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 12, high, int(signed)
    if compressed:
        dataset.compress(RLELossless, generate_instance_uid=False)
    assert read(dataset).tolist() == values.tolist()


@pytest.mark.parametrize("high", [10, 16])
def test_a_high_bit_that_cannot_be_is_refused(high: int) -> None:
    dataset = dataset_of(VALUES)
    dataset.BitsStored, dataset.HighBit = 12, high
    with pytest.raises(ImageUnreadable, match=rf"of 12 stored bits in 16 is {high} \(11 to 15 in .*correct Bits"):
        read(dataset)


def test_an_unusual_high_bit_of_a_jpeg_is_refused() -> None:
    dataset = jpeg_of(np.full((16, 16), 90, np.uint8))
    dataset.BitsAllocated, dataset.HighBit = 16, 15
    with pytest.raises(ImageUnreadable, match=r"of 8 stored bits in 16 is 15 \(7 to 7 in JPEG .*uncompressed"):
        read(dataset)


def coloured(pixels: NDArray[np.uint8]) -> Dataset:
    dataset = dataset_of(VALUES)
    dataset.Rows, dataset.Columns = pixels.shape[:2]
    dataset.SamplesPerPixel, dataset.PlanarConfiguration, dataset.PhotometricInterpretation = 3, 0, "RGB"
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit = 8, 8, 7
    dataset.PixelData = pixels.tobytes()
    return dataset


def test_a_screen_copy_in_equal_colours_is_grey() -> None:
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8)
    assert read(coloured(np.repeat(grey[..., None], 3, axis=2))) == pytest.approx(grey, abs=0.01)


def test_a_coloured_picture_is_refused() -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:, :4, 0] = 200
    with pytest.raises(ImageUnreadable, match=r"50 % of the pixels are coloured \(limit 2 %\)"):
        read(coloured(picture))


def test_a_grey_image_of_three_values_a_pixel_is_refused() -> None:
    dataset = coloured(np.zeros((8, 8, 3), np.uint8))
    dataset.PhotometricInterpretation = "MONOCHROME2"
    with pytest.raises(ImageUnreadable, match="is MONOCHROME2 of 3 values a pixel; needed is MONOCHROME1"):
        read(dataset)


def test_a_compressed_image_is_the_same_image() -> None:
    plain = np.random.default_rng(4).integers(0, 4096, (32, 40)).astype(np.uint16)
    dataset = dataset_of(plain)
    dataset.compress(RLELossless, generate_instance_uid=False)
    assert (read(dataset) == plain).all()


def jpeg_of(plain: NDArray[np.uint8]) -> Dataset:
    dataset = dataset_of(VALUES)
    set_pixel_data(dataset, plain, "MONOCHROME2", 8)
    dataset.PixelData = encapsulate([cv2.imencode(".jpg", plain, (cv2.IMWRITE_JPEG_QUALITY, 100))[1].tobytes()])
    dataset["PixelData"].is_undefined_length = True
    dataset.file_meta.TransferSyntaxUID = JPEGBaseline8Bit
    return dataset


def test_a_jpeg_is_decoded() -> None:
    y, x = np.mgrid[:64, :64]
    plain = (100.0 + x + 0.5 * y).astype(np.uint8)
    assert read(jpeg_of(plain)) == pytest.approx(plain, abs=2.0)


def test_what_an_association_offers_can_be_decoded() -> None:
    offered = decodable_syntaxes()
    assert len(offered) == len(set(offered)) >= 12
    assert JPEGLosslessSV1 in offered


def test_bits_of_an_eight_bit_image_are_kept() -> None:
    dataset = dataset_of(VALUES)
    set_pixel_data(dataset, np.array([[7, 200]], np.uint8), "MONOCHROME2", 8)
    assert read(dataset).tolist() == [[7.0, 200.0]]
