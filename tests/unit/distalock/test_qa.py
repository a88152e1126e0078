"""`distalock qa` on rendered images of the shipped ring."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from distalock.__main__ import main
from tests.unit.services.imaging.synthetic import RING_FILE, Scene, default_ring, render

MOVED_BALL = 57


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images at other angles of the display."""
    made = tmp_path_factory.mktemp("ring images")
    for number in range(3):
        pixels = render(Scene(seed=40 + number, turn_deg=70.0 * number, others=6), default_ring()).pixels
        cv2.imwrite(str(made / f"shot{number}.png"), pixels.astype(np.uint16))
    return made


def qa(folder: Path, out: Path, ring: Path = RING_FILE) -> int:
    return main(["qa", str(folder), "--ring", str(ring), "--out", str(out)])


def test_a_good_ring_is_good_and_stays_so(folder: Path, tmp_path: Path) -> None:
    assert qa(folder, tmp_path) == 0
    first = json.loads((tmp_path / "qa.json").read_text())
    assert (first["schema"], first["verdict"], first["drift"]) == ("distalock/qa/1", "good", None)
    assert [i["verdict"] for i in first["images"]] == ["accepted"] * 3
    assert len(first["balls"]) == 120
    assert np.median([b["rms_mm"] for b in first["balls"]]) < 0.02
    assert first["mean_source_mm"] == pytest.approx([4.0, -6.0, -968.0], abs=1.0)
    page = (tmp_path / "qa.html").read_text()
    assert page.count("<svg") == 2
    assert page.count("data:image/png;base64,") == 3
    assert qa(folder, tmp_path) == 0
    second = json.loads((tmp_path / "qa.json").read_text())
    assert second["drift"]["since"] == first["made_at"]
    assert second["drift"]["source_mm"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert json.loads((tmp_path / "qa-before.json").read_text()) == first


def test_a_ball_that_is_not_where_the_file_says_is_found(folder: Path, tmp_path: Path) -> None:
    content = json.loads(RING_FILE.read_text())
    content["balls"][MOVED_BALL]["position_mm"][0] += 0.15
    (tmp_path / "ring.json").write_text(json.dumps(content))
    assert qa(folder, tmp_path / "out", tmp_path / "ring.json") == 3
    report = json.loads((tmp_path / "out" / "qa.json").read_text())
    name = content["balls"][MOVED_BALL]["id"]
    assert [b["id"] for b in report["balls"] if b["flagged"]] == [name]
    assert report["verdict"] == "attention"
    assert report["findings"][0].startswith(f"ball {name} is 0.1")
    assert "measure or replace the ring" in report["findings"][0]


def test_refused_images_are_told(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images = tmp_path / "images"
    images.mkdir()
    (images / "shot.png").write_bytes((folder / "shot0.png").read_bytes())
    (images / "empty.png").write_bytes(cv2.imencode(".png", np.full((600, 600), 9, np.uint8))[1].tobytes())
    (images / "broken.dcm").write_bytes(b"rubbish")
    assert qa(images, tmp_path / "out") == 3
    printed = capsys.readouterr().out
    assert "attention: 1 of 3 images accepted" in printed
    assert "empty.png was refused: the image has only 1 different grey values" in printed
    assert "broken.dcm was refused: broken.dcm: 7 bytes that are not an image" in printed
    assert "1 images are too few to report single balls" in printed


def test_bad_input_is_one_line(tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert qa(tmp_path, tmp_path / "out") == 2
    (tmp_path / "qa.json").write_text("{}")
    assert qa(folder, tmp_path) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "0 images (at least 1, PNG, TIFF or DICOM)" in lines[0]
    assert "no quality report" in lines[1]
    assert len(lines) == 2
