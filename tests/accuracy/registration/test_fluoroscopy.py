"""Independent X-ray images with known truth, where they are at hand: axes, refusals, honest uncertainty."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from distalock.locate import NominalOptions, locate_image, read_parts
from shared.messages.registration import Method

FOLDER = Path(os.environ.get("DISTALOCK_FLUOROSCOPY", Path(__file__).parents[4] / "shared" / "fluoroscopy"))
pytestmark = [
    pytest.mark.skipif(not (FOLDER / "manifest.json").is_file(), reason=f"no fluoroscopy images in {FOLDER}"),
    pytest.mark.slow,
]
# A spread of tilts, materials, displays and doses; the whole folder is scored by its own program.
GOOD = ("dev00.png", "dev05.png", "dev07.png", "dev22.png", "dev31.png")
REFUSED = {"dev08.png": "nail_not_found", "dev09.png": "guide_not_found"}


def entry_of(name: str) -> dict[str, object]:
    manifest = json.loads((FOLDER / "manifest.json").read_text())
    return next(entry for entry in manifest["images"] if entry["image"] == name)


def located(name: str, method: Method = "model") -> tuple[str, list[str], dict[str, tuple[float, float]]]:
    """Verdict, reason codes, and per hole the errors in mm and degrees."""
    entry = entry_of(name)
    parts = read_parts(FOLDER / "ring.json", FOLDER / "guide.json", FOLDER / str(entry["nail"]))
    message = locate_image(FOLDER / name, parts, NominalOptions(1000.0, 0.235), method).message
    truth = {h["id"]: h for h in json.loads((FOLDER / str(entry["truth"])).read_text())["holes"]}
    errors = {}
    for hole in message.holes or ():
        axis = np.array(truth[hole.id]["axis_guide"])
        found = np.array(hole.axis_guide)
        apart = np.array(hole.entry_point_guide_mm) - truth[hole.id]["entry_point_guide_mm"]
        across_mm = float(np.linalg.norm(apart - axis * (apart @ axis)))
        errors[hole.id] = (
            across_mm,
            float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, found)), axis @ found))),
        )
    return message.verdict, [reason.code.value for reason in message.reasons], errors


@pytest.mark.parametrize("name", GOOD)
def test_good_images_are_accepted_and_right(name: str) -> None:
    verdict, codes, errors = located(name)
    print(name, errors)
    assert verdict == "accepted", codes
    for across_mm, axis_deg in errors.values():
        assert across_mm < 0.3
        assert axis_deg < 1.0


@pytest.mark.parametrize("name", REFUSED)
def test_images_without_nail_or_guide_are_refused_for_that(name: str) -> None:
    verdict, codes, _ = located(name)
    assert verdict == "rejected"
    assert REFUSED[name] in codes


def test_wires_over_the_holes_are_left_out_of_the_fit() -> None:
    verdict, codes, errors = located("dev10.png")
    assert verdict == "accepted", codes
    assert all(mm < 0.3 and deg < 1.0 for mm, deg in errors.values())


def test_a_side_view_is_refused_or_right() -> None:
    verdict, _, errors = located("dev11.png")
    assert verdict == "rejected" or all(mm < 1.0 and deg < 1.5 for mm, deg in errors.values())


def test_the_papers_method_finds_axes_in_a_round_view_but_moves_nothing() -> None:
    verdict, codes, errors = located("dev00.png", "fronto-parallel")
    print("dev00.png", errors)
    assert verdict == "rejected"
    assert set(codes) == {"uncertainty_too_large"}
    for across_mm, axis_deg in errors.values():
        assert across_mm < 0.5
        assert axis_deg < 1.5


def test_the_papers_method_refuses_holes_that_do_not_look_round() -> None:
    verdict, codes, errors = located("dev04.png", "fronto-parallel")
    assert (verdict, codes, errors) == ("rejected", ["tilt_too_large"], {})
