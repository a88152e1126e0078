"""`distalock locate` and `verify` on bad input: one sentence on stderr, exit code 2, nothing half-written."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from distalock.__main__ import main
from distalock.arguments import EXIT_BAD_INPUT
from distalock.locate import EXIT_REJECTED, NominalOptions
from services.imaging.devices.received_image import Acquisition, Polarity
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, file_of
from tests.unit.services.registration.rendered_case import GUIDE_JSON, NAIL_JSON, RING_JSON


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    contents = {"ring": RING_JSON, "guide": GUIDE_JSON, "nail": NAIL_JSON}
    for name, content in contents.items():
        (tmp_path / f"{name}.json").write_text(content)
    cv2.imwrite(str(tmp_path / "image.png"), _image())
    return {name: tmp_path / f"{name}.json" for name in contents} | {"image": tmp_path / "image.png"}


def _image() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    rng = np.random.default_rng(1)
    return rng.normal(128.0, 5.0, (400, 400)).clip(0, 255).astype(np.uint8)


def locate(files: dict[str, Path], *more: str) -> list[str]:
    parts = [part for name in ("ring", "guide", "nail") for part in (f"--{name}", str(files[name]))]
    return ["locate", str(files["image"]), *parts, *more]


def one_sentence(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What stands on stderr beside a result."""
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    return told


def test_an_image_without_a_ring_is_rejected(files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(locate(files)) == EXIT_REJECTED
    printed = json.loads(capsys.readouterr().out)
    assert printed["schema"] == "distalock/localisation/1"
    assert printed["verdict"] == "rejected"
    assert [reason["code"] for reason in printed["reasons"]] == ["ring_not_found"]
    assert printed["reasons"][0]["message"]
    assert (printed["camera"], printed["guide"], printed["holes"]) == (None, None, None)
    assert printed["timing_ms"]["total"] >= printed["timing_ms"]["ring"]


def test_several_images_make_one_object_that_tells_of_each(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.flipud(_image()))
    words = locate(files)
    assert main([*words[:2], str(other), *words[2:]]) == EXIT_REJECTED
    printed = json.loads(capsys.readouterr().out)
    assert printed["schema"] == "distalock/localisation/1"
    assert [image["used"] for image in printed["fusion"]["images"]] == [False, False]
    told = [reason["message"] for reason in printed["reasons"]]
    assert any(message.startswith("image image.png: ") for message in told)
    assert any(message.startswith("image other.png: ") for message in told)


def test_several_images_without_each_are_announced_as_one_set_up(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.flipud(_image()))
    words = locate(files)
    main([*words[:2], str(other), *words[2:]])
    assert "2 images are taken as one set-up; --each localises each by itself" in one_line(capsys)


def test_each_image_of_a_folder_has_a_line_of_its_own(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), _image())
    (folder / "b.png").write_bytes(b"no image at all")
    words = locate(files, "--each")
    assert main([words[0], str(folder), *words[1:]]) == EXIT_BAD_INPUT
    first, second, third = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first["image_file"], first["schema"], first["verdict"]) == (
        str(folder / "a.png"),
        "distalock/localisation/1",
        "rejected",
    )
    assert (second["image_file"], second["schema"]) == (str(folder / "b.png"), "distalock/unreadable-image/1")
    assert "that are not an image" in second["error"]
    assert third["image_file"] == str(files["image"])


def test_each_with_rejected_images_only_is_a_rejection(files: dict[str, Path]) -> None:
    assert main(locate(files, "--each")) == EXIT_REJECTED


def test_a_folder_needs_each(files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = locate(files)
    assert main([words[0], str(tmp_path), *words[2:]]) == EXIT_BAD_INPUT
    assert "it is a folder; `distalock locate --each` localises each of its images" in one_sentence(capsys)


def test_a_part_is_named_by_its_file_or_by_its_name_in_the_catalogue(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["locate", str(files["image"]), "--guide", "guide-28", "--nail", "nail-femur-ti-10"]
    assert main([*words, "--ring", "ring-120"]) == EXIT_REJECTED
    capsys.readouterr()
    assert main([*words, "--ring", "ring-of-gold"]) == EXIT_BAD_INPUT
    assert "ring-of-gold: cannot be read: No such file or directory; check its name (the catalogue has ring-120)" in (
        one_sentence(capsys)
    )


def test_one_image_given_twice_is_bad_input(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy.png"
    copy.write_bytes(files["image"].read_bytes())
    words = locate(files)
    assert main([*words[:2], str(copy), *words[2:]]) == EXIT_BAD_INPUT
    assert "copy.png: is the same image as" in one_sentence(capsys)


def test_a_rejected_image_is_drawn_too(files: dict[str, Path], tmp_path: Path) -> None:
    drawn = tmp_path / "drawn.png"
    assert main(locate(files, "--overlay", str(drawn))) == EXIT_REJECTED
    image = cv2.imread(str(drawn))
    assert image is not None
    assert image.shape == (400, 400, 3)


@pytest.mark.parametrize(
    ("overlay", "sentence"),
    [
        ("none/drawn.png", "cannot be written: there is no folder"),
        ("folder", "cannot be written: it is a folder"),
        ("/proc/drawn.png", "/proc/drawn.png: cannot be written: "),
    ],
)
def test_an_overlay_that_cannot_be_written_is_told_before_anything_is_read(
    overlay: str, sentence: str, files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    files["image"].unlink()  # would be told of first, were it looked at first
    with pytest.raises(SystemExit, match="2"):
        main(locate(files, "--overlay", str(tmp_path / overlay)))
    assert sentence in one_sentence(capsys)


def test_an_overlay_does_not_replace_the_image(files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    before = files["image"].read_bytes()
    assert main(locate(files, "--overlay", str(files["image"]))) == EXIT_BAD_INPUT
    assert "would replace a file that the result is made from; name another file" in one_sentence(capsys)
    assert files["image"].read_bytes() == before


@pytest.mark.parametrize("command", ["locate", "verify"])
def test_missing_and_foreign_files(command: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    words = [command, *locate(files)[1:]]
    files["image"].write_bytes(b"no image at all")
    assert main(words) == EXIT_BAD_INPUT
    assert "not an image" in one_sentence(capsys)
    files["image"].unlink()
    assert main(words) == EXIT_BAD_INPUT
    assert "cannot be read: No such file" in one_sentence(capsys)


def test_three_images_with_wires_are_too_many(files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    names = [str(files["image"])] * 2
    assert main(["verify", *names, *locate(files)[1:]]) == EXIT_BAD_INPUT
    assert (
        "3 images with wires were given (limit 2: a lateral and an oblique one); leave the others out"
        in one_sentence(capsys)
    )


@pytest.mark.parametrize(
    ("part", "change", "expected"),
    [
        ("ring", {"colour": "red"}, "colour: Extra inputs are not permitted"),
        ("guide", {"ball_count": 27}, "ball_count says 27, the file lists 28 balls"),
        ("nail", {"material": "wood"}, "material"),
        (
            "ring",
            {"schema": "distalock/guide/1"},
            "its schema is 'distalock/guide/1', needed is 'distalock/ring/1'; name",
        ),
    ],
)
def test_part_files_that_break_their_schema(
    part: str, change: dict[str, object], expected: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    files[part].write_text(json.dumps(json.loads(files[part].read_text()) | change))
    assert main(locate(files)) == EXIT_BAD_INPUT
    assert expected in one_sentence(capsys)


def test_a_hole_beside_the_nail_is_refused(files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    nail = json.loads(NAIL_JSON)
    nail["holes"][0]["position_mm"] = [15.0, 8.0, 0.0]
    files["nail"].write_text(json.dumps(nail))
    assert main(locate(files)) == EXIT_BAD_INPUT
    assert (
        "the axis of hole 'distal' passes the nail's axis at 8.00 mm (limit 3.00 in a nail of 12 mm)"
        in one_sentence(capsys)
    )


@pytest.mark.parametrize("value", ["-3", "0", "nan", "inf", "1e-300", "235", "0.2,0.2", ""])
def test_impossible_lengths_are_refused(value: str, files: dict[str, Path]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(locate(files, f"--pixel-mm={value}"))


def test_option_goes_before_header_before_default() -> None:
    header = Acquisition(source_to_detector_mm=1010.0)
    geometry = NominalOptions(pixel_mm=0.3).geometry(header)
    assert (geometry.source_to_detector_mm, geometry.pixel_mm) == (1010.0, 0.3)
    assert NominalOptions(990.0).geometry(header).source_to_detector_mm == 990.0
    assert NominalOptions().geometry(Acquisition()).pixel_mm == 0.235


def test_inverted_images_are_turned_round_without_changing_their_range() -> None:
    read = np.array([[10.0, 30.0], [200.0, 110.0]], dtype=np.float32)
    turned = NominalOptions(polarity=Polarity.INVERTED).pixels(read)
    assert turned.tolist() == [[200.0, 180.0], [10.0, 100.0]]
    assert NominalOptions().pixels(read) is read


def test_what_was_assumed_is_printed(files: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(locate(files, "--source-to-detector-mm=990", "--invert", "--focal-spot-mm=0.6")) == EXIT_REJECTED
    (note,) = json.loads(capsys.readouterr().out)["notes"]
    assert note == "ImagerPixelSpacing is assumed to be 0.235 mm: neither a person nor the image states it"


def test_a_header_that_cannot_be_right_is_one_sentence(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = dataset_of(_image().astype(np.uint16))
    dataset.ImagerPixelSpacing = ["1e-9", "1e-9"]
    files["image"].write_bytes(file_of(dataset))
    assert main(locate(files)) == EXIT_BAD_INPUT
    assert "ImagerPixelSpacing (0018,1164) is 1e-09 and 1e-09 mm (0.05 to 2); correct" in one_sentence(capsys)
    assert main(locate(files, "--pixel-mm=0.2")) == EXIT_REJECTED


def _advise(files: dict[str, Path], *more: str) -> list[str]:
    return ["mounting-site", str(files["image"]), "--ring", str(files["ring"]), "--nail", str(files["nail"]), *more]


def test_no_mounting_site_is_advised_without_a_ring(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    overlay = tmp_path / "drawn.png"
    assert main(_advise(files, "--overlay", str(overlay))) == EXIT_REJECTED
    said = json.loads(capsys.readouterr().out)
    assert said["mounting_site"] is None
    assert [reason["code"] for reason in said["reasons"]] == ["ring_not_found"]
    assert cv2.imread(str(overlay)) is not None


def test_a_mounting_site_does_not_overwrite_what_it_reads(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    before = files["nail"].read_bytes()
    assert main(_advise(files, "--overlay", str(files["nail"]))) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1
    assert files["nail"].read_bytes() == before
