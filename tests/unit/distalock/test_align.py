"""`distalock align`: images, folders and videos in order, one JSON line per frame, one sentence on bad input."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from distalock.__main__ import main
from distalock.align import frames_of
from distalock.arguments import EXIT_BAD_INPUT
from distalock.locate import EXIT_REJECTED
from shared.errors import ImageUnreadable
from tests.unit.services.registration.rendered_case import GUIDE_JSON, NAIL_JSON, RING_JSON


def picture(seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.random.default_rng(seed).normal(128.0, 5.0, (400, 400)).clip(0, 255).astype(np.uint8)


@pytest.fixture
def film(tmp_path: Path) -> Path:
    folder = tmp_path / "film"
    folder.mkdir()
    for name in ("b.png", "a.png"):
        cv2.imwrite(str(folder / name), picture(ord(name[0])))
    (folder / "notes.txt").write_text("not a frame")
    return folder


def align(tmp_path: Path, *images: Path) -> int:
    parts = []
    for name, content in (("ring", RING_JSON), ("guide", GUIDE_JSON), ("nail", NAIL_JSON)):
        (tmp_path / f"{name}.json").write_text(content)
        parts += [f"--{name}", str(tmp_path / f"{name}.json")]
    return main(["align", *map(str, images), *parts])


def test_every_frame_is_one_line_in_order(film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert align(tmp_path, film) == EXIT_REJECTED
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["image"]["sequence"] for line in lines] == [1, 2]
    assert {line["schema"] for line in lines} == {"distalock/guidance/1"}
    assert {line["verdict"] for line in lines} == {"rejected"}
    assert {reason["code"] for line in lines for reason in line["reasons"]} == {"ring_not_found"}
    assert all(line["reasons"][0]["message"] and line["holes"] is None for line in lines)


def test_a_folder_is_read_by_name_and_what_is_no_image_is_left_out(film: Path) -> None:
    first, second = (frame.pixels for frame in frames_of([film]))
    assert np.corrcoef(first.ravel(), picture(ord("a")).ravel())[0, 1] > 0.99
    assert np.corrcoef(second.ravel(), picture(ord("b")).ravel())[0, 1] > 0.99


def test_a_video_is_frames(tmp_path: Path) -> None:
    file = tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (400, 400), isColor=False)
    for seed in (1, 2, 3):
        writer.write(picture(seed))
    writer.release()
    frames = list(frames_of([file]))
    assert [frame.pixels.shape for frame in frames] == [(400, 400)] * 3
    assert len({frame.sha256 for frame in frames}) == 3


def test_a_dicom_file_of_a_folder_needs_no_ending(tmp_path: Path) -> None:
    folder = tmp_path / "exported"
    folder.mkdir()
    (folder / "README").write_text("not a frame")
    (folder / "I0001").write_bytes(bytes(128) + b"DICM" + b"rubbish")
    with pytest.raises(ImageUnreadable, match="I0001"):
        list(frames_of([folder]))


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("empty", "empty: holds no PNG, TIFF or DICOM files (0 found, 1 needed); name"),
        ("missing.png", "missing.png: there is no such file or folder (0 found, 1 needed); check its name"),
        ("missing.mp4", "missing.mp4: there is no such file or folder (0 found, 1 needed); check its name"),
        ("empty.mp4", "empty.mp4: none of its 0 bytes could be decoded as video (0 frames found, 1 needed); record"),
        ("broken.avi", "broken.avi: none of its 8 bytes could be decoded as video (0 frames found, 1 needed); record"),
    ],
)
def test_bad_input_is_one_sentence_before_any_frame_is_told(
    name: str, sentence: str, film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.avi").write_bytes(b"no video")
    (tmp_path / "empty.mp4").write_bytes(b"")
    assert align(tmp_path, film, tmp_path / name) == EXIT_BAD_INPUT
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("distalock align: ")
    assert sentence in captured.err


def test_what_the_video_library_says_is_not_told(tmp_path: Path) -> None:
    """In a process of its own: the library asks once whether it may speak."""
    (tmp_path / "empty.mp4").write_bytes(b"")
    program = f"from distalock.align import *; require_frames([Path({str(tmp_path / 'empty.mp4')!r})])"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "ImageUnreadable" in ended.stderr
    assert "moov atom" not in ended.stderr
