"""`distalock robot workspace`: the drawing, and bad input."""

from pathlib import Path

import numpy as np
import pytest

from distalock.__main__ import main
from distalock.robot_workspace import ANGLES_DEG, drawing
from shared.geometry.hexapod_workspace import workspace_map
from shared.parts.hexapod_file import default_hexapod


def test_the_drawing_has_a_colour_for_every_free_tilt() -> None:
    grid = np.arange(-18.0, 19.0, 6.0)
    found = workspace_map(default_hexapod(), np.array([60.0, 0.0, 20.0]), (grid, grid, grid), ANGLES_DEG, 6)
    image = drawing(found, "a robot")
    colours = {tuple(c) for c in image.reshape(-1, 3).tolist()}
    assert {(235, 235, 235), (181, 113, 69)} <= colours
    assert image.shape[2] == 3


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["--head-extension-mm", "90"],
            "head extension is 90 mm, the head of 'distalock H70' can be set from 40 to 80 mm",
        ),
        (["--hexapod", "nowhere.json"], "nowhere.json: cannot be read: No such file or directory; check its name"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["robot", "workspace", "--out", str(tmp_path / "w.png"), *arguments])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
