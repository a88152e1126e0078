"""Which nominal value of an image counts, what is refused, and what the notes name."""

import numpy as np
import pytest
from pydicom.dataset import Dataset

from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.dicom_file import read_dicom
from services.imaging.devices.nominal_values import ImageNominal, StatedValues, nominal_of_image
from services.imaging.devices.received_image import Acquisition
from shared.errors import ImageUnreadable
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, file_of, grey_ramp

DEFAULT = NominalGeometry()


def acquisition(**attributes: object) -> Acquisition:
    dataset: Dataset = dataset_of(grey_ramp())
    for name, value in attributes.items():
        setattr(dataset, name, value)
    return read_dicom(file_of(dataset), "test").acquisition


def chosen(stated: StatedValues, **attributes: object) -> ImageNominal:
    return nominal_of_image(stated, acquisition(**attributes), DEFAULT)


@pytest.mark.parametrize(
    ("attributes", "sentence"),
    [
        (
            {"ImagerPixelSpacing": ["1e-9", "1e-9"]},
            r"ImagerPixelSpacing \(0018,1164\) is 1e-09 and 1e-09 mm \(0.05 to 2\); correct the header, or state",
        ),
        ({"ImagerPixelSpacing": ["0.2", "0.3"]}, r"is 0.2 and 0.3 mm \(one value, or equal ones\)"),
        (
            {"DistanceSourceToDetector": "98.5"},
            r"DistanceSourceToDetector \(0018,1110\) is 98.5 mm \(500 to 2000\); .* \(--source-to-detector-mm",
        ),
        ({"DistanceSourceToDetector": "-1000"}, r"is -1000 mm \(500 to 2000\)"),
    ],
)
def test_a_header_that_cannot_be_right_is_refused(attributes: dict[str, object], sentence: str) -> None:
    with pytest.raises(ImageUnreadable, match=sentence):
        chosen(StatedValues(), **attributes)


def test_a_stated_value_goes_before_such_a_header_and_the_note_names_it() -> None:
    nominal = chosen(StatedValues(1000.0, 0.3), ImagerPixelSpacing=["1e-9", "1e-9"])
    assert nominal.geometry == NominalGeometry(1000.0, 0.3)
    (note,) = nominal.notes
    assert note == "ImagerPixelSpacing (0018,1164) is 1e-09 and 1e-09 mm (0.05 to 2) and is ignored: 0.3 mm is stated"


def test_a_good_header_that_is_overruled_is_named() -> None:
    nominal = chosen(StatedValues(1000.0, 0.3), ImagerPixelSpacing=[0.2, 0.2])
    assert nominal.notes == ("ImagerPixelSpacing (0018,1164) is 0.2 mm and is ignored: 0.3 mm is stated",)


def test_what_nobody_states_is_assumed_and_named() -> None:
    nominal = chosen(StatedValues(), DistanceSourceToDetector=0.0)
    assert nominal.geometry == DEFAULT
    assert [note.partition(":")[0] for note in nominal.notes] == [
        "DistanceSourceToDetector is assumed to be 1000 mm",
        "ImagerPixelSpacing is assumed to be 0.235 mm",
    ]


def test_the_focal_spot_of_the_header_counts_when_it_is_one() -> None:
    stated = StatedValues(1000.0, 0.2)
    assert chosen(stated, FocalSpots=["0.3"]).geometry.focal_spot_mm == 0.3
    assert chosen(StatedValues(1000.0, 0.2, 0.6), FocalSpots=["0.3"]).geometry.focal_spot_mm == 0.6
    two = chosen(stated, FocalSpots=["0.3", "0.6"])
    assert two.geometry.focal_spot_mm is None
    assert two.notes == ("FocalSpots (0018,1190) is 0.3 and 0.6 mm (one value, or equal ones) and is ignored",)
    assert chosen(stated, FocalSpots=["60"]).geometry.focal_spot_mm is None


def test_nothing_is_noted_of_a_complete_header() -> None:
    nominal = chosen(StatedValues(), DistanceSourceToDetector=985.0, ImagerPixelSpacing=[0.21, 0.21])
    assert nominal == ImageNominal(NominalGeometry(985.0, 0.21), ())
    assert np.isclose(nominal.geometry.source_to_ring_mm, 985.0 * 0.975)
