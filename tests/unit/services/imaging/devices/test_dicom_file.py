import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray
from pydicom.uid import RLELossless

from services.imaging.devices.dicom_file import dicom_of_pixels, read_dicom
from services.imaging.devices.image_file import is_dicom
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, file_of, grey_ramp


def test_a_made_file_reads_back_the_same_pixels() -> None:
    content, uid = dicom_of_pixels(grey_ramp())
    assert is_dicom(content)
    image = read_dicom(content, "test")
    assert (image.pixels == grey_ramp()).all()
    assert image.pixels.dtype == np.float32
    assert (image.bits_stored, image.sop_instance_uid, image.dicom) == (16, uid, content)


def test_the_same_pixels_make_the_same_file_and_others_another() -> None:
    assert dicom_of_pixels(grey_ramp()) == dicom_of_pixels(grey_ramp())
    assert dicom_of_pixels(grey_ramp())[1] != dicom_of_pixels(grey_ramp()[:, ::-1])[1]


def test_eight_bits_and_an_odd_number_of_pixels() -> None:
    pixels = np.arange(15, dtype=np.uint8).reshape(3, 5)
    image = read_dicom(dicom_of_pixels(pixels)[0], "test")
    assert (image.pixels == pixels).all()
    assert image.bits_stored == 8


@pytest.mark.parametrize(
    ("photometric", "sign", "reversed_"),
    [
        ("MONOCHROME2", None, False),
        ("MONOCHROME1", None, True),
        ("MONOCHROME2", 1, False),
        ("MONOCHROME2", -1, True),
        ("MONOCHROME1", 1, False),
        ("MONOCHROME1", -1, True),
    ],
)
def test_polarity_is_normalised_to_darker_is_denser(photometric: str, sign: int | None, reversed_: bool) -> None:  # noqa: FBT001
    dataset = dataset_of(grey_ramp())
    dataset.PhotometricInterpretation = photometric
    if sign is not None:
        dataset.PixelIntensityRelationshipSign = sign
    dataset.BitsStored, dataset.HighBit = 14, 13
    pixels = read_dicom(file_of(dataset), "test").pixels
    expected = 2**14 - 1 - grey_ramp().astype(np.float32) if reversed_ else grey_ramp().astype(np.float32)
    assert (pixels == expected).all()


def test_a_falling_rescale_reverses_what_an_untagged_image_shows() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.RescaleSlope, dataset.RescaleIntercept = -1.0, 65535.0
    pixels = read_dicom(file_of(dataset), "test").pixels
    assert (np.diff(pixels.ravel()) < 0).all()


def test_nominal_geometry_is_read_and_nonsense_left_out() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.ImagerPixelSpacing = [0.21, 0.21]
    dataset.DistanceSourceToDetector = 985.0
    dataset.PositionerPrimaryAngle, dataset.PositionerSecondaryAngle = -12.5, 3.0
    dataset.Laterality = "R"
    dataset.Manufacturer, dataset.ManufacturerModelName = "Maker", "Model"
    made = read_dicom(file_of(dataset), "test").acquisition
    assert (made.pixel_mm, made.source_to_detector_mm) == (0.21, 985.0)
    assert (made.positioner_primary_angle_deg, made.positioner_secondary_angle_deg) == (-12.5, 3.0)
    assert (made.manufacturer, made.model_name) == ("Maker", "Model")
    assert made.laterality == "right"
    dataset.ImageLaterality = "L"
    assert read_dicom(file_of(dataset), "test").acquisition.laterality == "left"
    dataset.ImageLaterality = "B"
    assert read_dicom(file_of(dataset), "test").acquisition.laterality is None
    dataset.DistanceSourceToDetector = 0.0
    assert read_dicom(file_of(dataset), "test").acquisition.source_to_detector_mm is None


@pytest.mark.parametrize("keep", [0.99, 0.7, 0.5])
def test_a_truncated_file_is_refused_in_one_sentence(keep: float) -> None:
    content = dicom_of_pixels(np.zeros((64, 64), np.uint16))[0]
    with pytest.raises(ImageUnreadable, match=r"truncated.*send") as refused:
        read_dicom(content[: int(keep * len(content))], "shot 7")
    assert str(refused.value).startswith("shot 7: ")
    assert "\n" not in str(refused.value)


def test_only_the_mark_of_dicom_is_left() -> None:
    with pytest.raises(ImageUnreadable, match="DICOM"):
        read_dicom(b"\0" * 128 + b"DICM" + b"rubbish" * 5, "shot")


def test_a_photometric_interpretation_that_is_not_grey_is_refused() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.PhotometricInterpretation = "PALETTE COLOR"
    with pytest.raises(ImageUnreadable, match=r"photometric interpretation is PALETTE COLOR; needed is MONOCHROME1"):
        read_dicom(file_of(dataset), "test")


def run_of(frames: NDArray[np.uint16]) -> bytes:
    """A multi-frame object, frames of shape (frames, rows, columns)."""
    dataset = dataset_of(frames[0])
    dataset.NumberOfFrames = len(frames)
    dataset.PixelData = frames.tobytes()
    return file_of(dataset)


def ball_at(x: float, rng: np.random.Generator) -> NDArray[np.uint16]:
    row, column = np.mgrid[:128, :128]
    shadow = 3000.0 / (1.0 + np.exp(np.hypot(column - x, row - 60.0) - 9.0))
    return np.asarray(4000.0 - shadow + rng.normal(0.0, 80.0, row.shape), dtype=np.uint16)


def test_a_run_of_still_frames_is_averaged() -> None:
    rng = np.random.default_rng(1)
    frames = np.stack([ball_at(50.0, rng) for _ in range(9)])
    pixels = read_dicom(run_of(frames), "run").pixels
    assert pixels == pytest.approx(frames.mean(axis=0), abs=0.1)
    assert pixels[:30].std() < 0.4 * frames[0, :30].astype(float).std()


def test_only_the_still_part_of_a_run_is_averaged() -> None:
    rng = np.random.default_rng(2)
    frames = np.stack([ball_at(20.0 + 5.0 * min(i, 4), rng) for i in range(12)])
    assert read_dicom(run_of(frames), "run").pixels == pytest.approx(frames[4:].mean(axis=0), abs=0.1)


def test_a_run_in_which_all_moves_is_refused() -> None:
    rng = np.random.default_rng(3)
    frames = np.stack([ball_at(20.0 + 4.0 * i, rng) for i in range(8)])
    with pytest.raises(
        ImageUnreadable, match=r"run of 8 frames ends with 1 after its last motion \(at least 3\); hold leg"
    ):
        read_dicom(run_of(frames), "run")


def test_a_run_across_a_motion_shows_the_place_after_it() -> None:
    """A run that was recorded while the robot moved is bound to where the robot stands when the run arrives."""
    rng = np.random.default_rng(5)
    before, moving = [20.0] * 20, [20.0 + 4.0 * k for k in range(1, 11)]
    frames = np.stack([ball_at(x, rng) for x in (*before, *moving, *[80.0] * 10)])
    assert read_dicom(run_of(frames), "run").pixels == pytest.approx(frames[-10:].mean(axis=0), abs=0.1)


def test_a_run_that_ends_soon_after_a_motion_is_refused() -> None:
    rng = np.random.default_rng(6)
    frames = np.stack([ball_at(x, rng) for x in (*[20.0] * 20, 60.0, 60.0)])
    with pytest.raises(
        ImageUnreadable,
        match=r"run of 22 frames ends with 2 after its last motion \(at least 3\); hold leg and C-arm still until the",
    ):
        read_dicom(run_of(frames), "run")


def test_a_run_of_more_pixels_than_memory_is_refused() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.NumberOfFrames = 10**9
    with pytest.raises(ImageUnreadable, match="1000000000 frames of 8 x 6 are 48000000000 values"):
        read_dicom(file_of(dataset), "test")


def test_a_run_of_frames_too_large_to_be_averaged_is_refused() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.Rows, dataset.Columns, dataset.NumberOfFrames = 4096, 4100, 3
    with pytest.raises(ImageUnreadable, match=r"a run, of 4100 x 4096, has 16793600 values \(at most 16777216\); send"):
        read_dicom(file_of(dataset), "test")


def test_values_of_more_bits_than_are_read_are_refused() -> None:
    dataset = dataset_of(grey_ramp())
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit = 32, 12, 11
    with pytest.raises(ImageUnreadable, match=r"8 x 6 pixels of 12 bits in 32 \(at most 8192 each way, 1 to 16 bits\)"):
        read_dicom(file_of(dataset), "test")


def test_a_run_is_decoded_frame_by_frame() -> None:
    """Memory is that of the file and of some frames, whatever the number of frames is."""
    rng = np.random.default_rng(7)
    dataset = dataset_of(ball_at(50.0, rng))
    dataset.BitsStored, dataset.HighBit, dataset.NumberOfFrames = 12, 11, 64
    dataset.PixelData = 64 * dataset.PixelData
    content = file_of(dataset)
    tracemalloc.start()
    try:
        read_dicom(content, "run")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2 * len(content)


def test_a_run_with_fewer_frames_than_stated_is_refused() -> None:
    frames = np.stack([grey_ramp()] * 4)
    dataset = dataset_of(frames[0])
    dataset.NumberOfFrames, dataset.PixelData = 4, frames.tobytes()
    dataset.compress(RLELossless, generate_instance_uid=False)
    dataset.NumberOfFrames = 5
    with pytest.raises(ImageUnreadable, match="run: the object states 5 frames and has 4; send it again"):
        read_dicom(file_of(dataset), "run")


def test_an_object_without_pixels_is_refused() -> None:
    dataset = dataset_of(grey_ramp())
    del dataset.PixelData
    with pytest.raises(ImageUnreadable, match="no pixels"):
        read_dicom(file_of(dataset), "test")
