"""`distalock calibrate` on bad input: one sentence on stderr, exit code 2; and its result by views that are known."""

import json
from pathlib import Path

import numpy as np
import pytest

from distalock.__main__ import main
from distalock.arguments import EXIT_BAD_INPUT
from distalock.image_files import ImageFile
from distalock.part_calibration.command import Part, View, calibrated
from distalock.part_calibration.displacements import Displacements
from distalock.part_calibration.guide_views import GuideView, guide_displacements
from services.imaging.devices.received_image import Acquisition, ImageContent
from shared.errors import InputError
from tests.unit.distalock.part_calibration.test_displacements import BUILT_SD_MM, GUIDE, GUIDE_JSON, guide_views

NO_PIXELS = ImageContent(np.zeros((2, 2), dtype=np.float32), Acquisition())


def shown(count: int) -> tuple[ImageFile, ...]:
    return tuple(ImageFile(Path(f"{k}.png"), str(k), NO_PIXELS) for k in range(count))


def guide_of(views: dict[str, View | str]) -> Part:
    def solve(views: object) -> Displacements:
        assert isinstance(views, list)
        return guide_displacements(tuple(one for one in views if isinstance(one, GuideView)), GUIDE)

    return Part("guide", GUIDE_JSON, GUIDE.sha256, GUIDE.balls, lambda file: views[file.path.name], solve)


def test_too_few_images_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k in range(5):
        (tmp_path / f"{k}.png").touch()
    assert main(["calibrate", "ring", str(tmp_path), "--ring", "ring-120"]) == EXIT_BAD_INPUT
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == "distalock calibrate: 5 images were given (6 to 40 needed); take as many\n"


def test_a_displaced_ball_is_named_and_the_measured_file_is_better() -> None:
    rng = np.random.default_rng(21)
    displacement = rng.normal(0.0, BUILT_SD_MM, GUIDE.balls.position_mm.shape)
    displacement[7] = [1.0, -1.0, 0.0]
    views = guide_views(GUIDE.balls.position_mm + displacement, rng, noise_px=0.1)
    names: dict[str, View | str] = {f"{k}.png": view for k, view in enumerate(views)}
    names["12.png"] = "the guide is not in it"
    message, measured = calibrated(guide_of(names), shown(13))
    assert message.verdict == "accepted"
    assert message.outliers == (GUIDE.balls.ids[7],)
    assert message.held_out_rms_after_px < 0.3 * message.held_out_rms_before_px
    roles = [image.role for image in message.images]
    assert (roles.count("fitted"), roles.count("held_out"), roles.count("left_out")) == (9, 3, 1)
    assert message.images[-1].why == "the guide is not in it"
    assert json.loads(measured)["frame_tolerance_deg"] == pytest.approx(message.frame_deg, abs=1e-4)


def test_a_part_as_filed_gains_little_and_is_not_spread() -> None:
    rng = np.random.default_rng(22)
    views = guide_views(GUIDE.balls.position_mm, rng, noise_px=0.1)
    message, _ = calibrated(guide_of({f"{k}.png": view for k, view in enumerate(views)}), shown(12))
    assert message.spread_mm < 0.01
    assert message.held_out_rms_after_px == pytest.approx(message.held_out_rms_before_px, rel=0.05)
    assert (message.verdict == "rejected") == bool(message.reasons)


def test_images_that_cannot_be_used_are_refused_with_the_first_reason() -> None:
    names: dict[str, View | str] = dict.fromkeys((f"{k}.png" for k in range(6)), "no ring")
    with pytest.raises(InputError, match=r"0 of 6 images could be used \(at least 6\); 0.png: no ring"):
        calibrated(guide_of(names), shown(6))
