"""All independent X-ray images, where they are at hand: axes, reason codes of refusals, honest uncertainty.

`make test` localises a seventh of those that must be accepted, and all that must be refused; `make long-tests` all.
The limits are 1.5 times what was measured when they were set, over the 28 images that must be accepted (as in
`docs/benchmarks/independent.md`): median and largest error of the entry 0.044 and 0.182 mm, of the axis 0.150 and 0.333
degrees; error over predicted standard uncertainty 1.05 and 1.09 rms.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.data.independent_images import independent_folder, listed_images
from distalock.locate import NominalOptions, locate_image, read_parts
from shared.messages.registration import Method

FOLDER = independent_folder()
pytestmark = [
    pytest.mark.skipif(FOLDER is None, reason="the independent X-ray images are not here"),
    pytest.mark.slow,
]
IMAGES = {image.name: image for image in listed_images(FOLDER)} if FOLDER is not None else {}
GOOD = [name for name, image in IMAGES.items() if image.entry.expect == "accept"]
REFUSED = {
    "dev08.png": ["nail_not_found"],
    "dev09.png": ["guide_not_found"],
    # a view along the guide, 38 degrees oblique, whose wires cover the holes
    "dev11.png": ["guide_not_found", "hole_not_visible"],
}
TESTED_EACH_TIME = GOOD[::7]
# the one image that may be either: a wire lies over each hole
WIRED = "dev10.png"
MEDIAN_MM, WORST_MM = 0.066, 0.273
MEDIAN_DEG, WORST_DEG = 0.225, 0.50


@dataclass(frozen=True, slots=True)
class Located:
    """What was found in one image; rows of `errors` are holes: entry in mm, axis in degrees, both over predicted."""

    verdict: str
    codes: list[str]
    errors: NDArray[np.float64]


@cache
def located(name: str, method: Method = "model") -> Located:
    image = IMAGES[name]
    parts = read_parts(image.ring, image.guide, image.nail)
    message = locate_image(image.path, parts, NominalOptions(**image.entry.nominal.model_dump()), method).message
    truth = {hole.id: hole for hole in image.truth().holes}
    errors = []
    for hole in message.holes or ():
        axis, found = np.array(truth[hole.id].axis_guide), np.array(hole.axis_guide)
        apart = np.array(hole.entry_point_guide_mm) - truth[hole.id].entry_point_guide_mm
        across_mm = float(np.linalg.norm(apart - axis * (apart @ axis)))
        turned_deg = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, found)), axis @ found)))
        predicted = hole.standard_uncertainty
        sd_mm, sd_deg = (np.nan, np.nan) if predicted is None else (predicted.entry_mm, predicted.axis_deg)
        errors.append((across_mm, turned_deg, across_mm / sd_mm, turned_deg / sd_deg))
    return Located(message.verdict, [reason.code.value for reason in message.reasons], np.array(errors).reshape(-1, 4))


def test_the_manifest_has_the_images_that_are_tested() -> None:
    assert len(GOOD) == 28
    assert IMAGES.keys() == {*GOOD, *REFUSED, WIRED}


@pytest.mark.parametrize(
    "name",
    [*TESTED_EACH_TIME, WIRED, *(pytest.param(n, marks=pytest.mark.long) for n in GOOD if n not in TESTED_EACH_TIME)],
)
def test_good_images_are_accepted_and_right(name: str) -> None:
    found = located(name)
    assert (found.verdict, found.codes) == ("accepted", [])
    assert len(found.errors) == 2
    assert found.errors[:, 0].max() < WORST_MM
    assert found.errors[:, 1].max() < WORST_DEG


@pytest.mark.parametrize("name", REFUSED)
def test_bad_images_are_refused_for_what_is_wrong_with_them(name: str) -> None:
    found = located(name)
    assert (found.verdict, found.codes) == ("rejected", REFUSED[name])


@pytest.mark.long
def test_errors_of_all_good_images_are_as_small_as_measured_and_predicted() -> None:
    worse_hole = np.array([located(name).errors[:, :2].max(axis=0) for name in GOOD])
    normalised = np.concatenate([located(name).errors[:, 2:] for name in GOOD])
    median, rms = np.median(worse_hole, axis=0), np.sqrt(np.mean(normalised**2, axis=0))
    print(f"median {median}, worst {worse_hole.max(axis=0)}, normalised {rms}")
    assert median[0] < MEDIAN_MM
    assert median[1] < MEDIAN_DEG
    assert np.all(rms > 0.7)
    assert np.all(rms < 1.6)


def test_the_papers_method_finds_axes_in_a_round_view_but_moves_nothing() -> None:
    found = located("dev00.png", "fronto-parallel")
    assert (found.verdict, set(found.codes)) == ("rejected", {"uncertainty_too_large"})
    # 0.163 mm and 0.503 degrees (docs/benchmarks/independent.md)
    assert found.errors[:, 0].max() < 0.25
    assert found.errors[:, 1].max() < 0.76


def test_the_papers_method_refuses_holes_that_do_not_look_round() -> None:
    found = located("dev04.png", "fronto-parallel")
    assert (found.verdict, found.codes, len(found.errors)) == ("rejected", ["tilt_too_large"], 0)
