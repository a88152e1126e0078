"""`distalock robot calibrate-guide` and `calibration-poses`: bad input, and what is written."""

import json
from pathlib import Path

import numpy as np
import pytest

from distalock.__main__ import main
from distalock.guide_calibration.hand_eye import GuideCalibration
from distalock.robot_calibration import write_hexapod
from shared.geometry.frames import Guide
from shared.geometry.transform import Transform
from shared.parts.files import read_part_file
from shared.parts.hexapod_file import DEFAULT_HEXAPOD, default_hexapod, hexapod_from_json

CATALOGUE = DEFAULT_HEXAPOD.parent
PARTS = ["--ring", str(CATALOGUE / "ring-120.json"), "--guide", str(CATALOGUE / "guide-28.json")]
ZERO = dict.fromkeys(("x_mm", "y_mm", "z_mm", "u_deg", "v_deg", "w_deg"), 0.0)


def poses_file(folder: Path, count: int, **changes: object) -> Path:
    images = [{"image": f"{i}.png", "pose": ZERO} for i in range(count)]
    content = {"schema": "distalock/guide-poses/1", "units": "mm", "images": images} | changes
    file = folder / "poses.json"
    file.write_text(json.dumps(content))
    return file


@pytest.mark.parametrize(
    ("count", "changes", "more", "sentence"),
    [
        (4, {}, [], "images: Tuple should have at least 5 items"),
        (5, {"units": "inch"}, [], "units: Input should be 'mm'"),
        (5, {}, [], "0.png: cannot be read: No such file"),
        (5, {}, ["--out", "nowhere/h.json"], "nowhere/h.json: cannot be written: there is no folder nowhere"),
        (
            5,
            {"images": [{"image": f"{i}.png", "pose": ZERO | {"z_mm": 40.0}} for i in range(5)]},
            [],
            "the robot cannot have stood in the pose of image 1 ('0.png'): leg",
        ),
        (5, {}, ["--head-extension-mm", "90"], "head extension is 90 mm, the head of 'distalock H70' can be set"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    count: int,
    changes: dict[str, object],
    more: list[str],
    sentence: str,
) -> None:
    file = poses_file(tmp_path, count, **changes)
    try:
        code = main(["robot", "calibrate-guide", str(file), *PARTS, *more])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


def test_the_hexapod_file_that_is_written_holds_the_guide_as_found(tmp_path: Path) -> None:
    hexapod = default_hexapod()
    off: Transform[Guide, Guide] = Transform.from_rotvec([0.01, -0.02, 0.005], [0.3, -0.2, 0.5])
    found = hexapod.top_from_guide(65.0) @ off
    calibration = GuideCalibration(found, np.eye(6), np.eye(4), 1.0)
    write_hexapod(tmp_path / "h.json", read_part_file(DEFAULT_HEXAPOD), calibration, 65.0)
    written = hexapod_from_json((tmp_path / "h.json").read_bytes())
    np.testing.assert_allclose(written.top_from_guide(65.0).matrix, found.matrix, atol=1e-12)
    np.testing.assert_allclose(written.base_joints_mm, hexapod.base_joints_mm)


def test_too_few_poses_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["robot", "calibration-poses", "--count", "3"])
    assert "'3' is not a number of images from 5 to 50" in capsys.readouterr().err
