"""`distalock bench`: options go to the benchmark that has some, and to no other."""

import json
from pathlib import Path

import pytest

from distalock.__main__ import main
from distalock.arguments import EXIT_BAD_INPUT
from distalock.bench import BENCHMARKS, ROOT


def test_options_belong_to_one_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "accuracy", "calibration", "--count", "1"]) == EXIT_BAD_INPUT
    assert "options belong to one benchmark; name one" in capsys.readouterr().err


def test_a_word_that_is_no_benchmark_after_several_names_runs_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "accuracy", "calibration", "nonsense"]) == EXIT_BAD_INPUT
    assert "options belong to one benchmark; name one" in capsys.readouterr().err


def test_all_takes_no_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "all", "--count", "1"]) == EXIT_BAD_INPUT
    assert "options belong to one benchmark; name one" in capsys.readouterr().err


def test_the_first_word_must_be_a_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["bench", "nonsense", "accuracy"])
    assert "there is no benchmark 'nonsense'" in capsys.readouterr().err


def test_a_word_after_the_name_is_an_action_of_the_benchmark(tmp_path: Path) -> None:
    before, after = tmp_path / "before.jsonl", tmp_path / "after.jsonl"
    rows = [
        json.dumps({"image": image, "verdict": "rejected", "codes": ["blurred"], "holes": {}}) + "\n" for image in "ab"
    ]
    before.write_text("".join(rows))
    after.write_text(rows[0])
    assert main(["bench", "same_results", "compare", str(before), str(after), "--subset"]) == 0
    assert main(["bench", "same_results", "compare", str(before), str(after)]) == 1
    before.write_text("")
    assert main(["bench", "same_results", "compare", str(before), str(after), "--subset"]) == 1, "nothing was compared"


def test_without_a_name_there_is_a_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench"]) == 0
    printed = capsys.readouterr().out
    assert all(f"\n{name} " in printed for name in BENCHMARKS)


def test_every_page_is_in_the_checkout() -> None:
    pages = {one.page for one in BENCHMARKS.values() if one.page}
    assert [page for page in sorted(pages) if not (ROOT / "docs" / "benchmarks" / f"{page}.md").is_file()] == []


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("guide_calibration", ["--nope"], "unrecognized arguments: --nope"),
        ("accuracy", ["--nope"], "unrecognized arguments: --nope"),
        ("accuracy", ["--count", "-3"], "'-3' is not a number of scenes from 1 to"),
        ("accuracy", ["--report", "/none/page.md"], "cannot be written: there is no folder /none"),
        ("cramer_rao", ["--seed", "x"], "'x' is not a seed from 0 to"),
        ("independent_images", ["--nope"], "unrecognized arguments: --nope"),
        ("image_time", ["--count", "0"], "'0' is not a number of scenes from 1 to"),
        ("noise_draws", ["--draws", "1"], "'1' is not a number of draws from 2 to"),
        ("same_results", [], "the following arguments are required: action"),
        ("same_results", ["nonsense"], "invalid choice: 'nonsense'"),
        ("stop_latency", ["locate"], "unrecognized arguments: locate"),
    ],
)
def test_wrong_options_of_a_benchmark_are_one_line(
    name: str, options: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["bench", name, *options])
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert captured.err.startswith(f"distalock bench {name}: ")
    assert expected in captured.err


def test_a_file_that_a_benchmark_cannot_use_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = tmp_path / "rows.jsonl"
    rows.write_text("a\nb\n")
    assert main(["bench", "accuracy", "--count", "1", "--limits", str(rows)]) == EXIT_BAD_INPUT
    told = capsys.readouterr()
    assert told.out == f"{rows}: 2 lines are no rows and left out; the first: a\n"
    assert told.err.startswith(f"distalock bench accuracy: {rows}: none of its 0 rows has limits")
    assert told.err.count("\n") == 1


def test_every_benchmark_is_listed() -> None:
    """A module of the folder that writes a page under docs/ can be called by its name."""
    folder = ROOT / "benchmarks"
    writing = {
        ".".join(file.relative_to(folder).with_suffix("").parts)
        for file in folder.glob("*/*.py")
        if "def main(" in file.read_text()
    }
    assert writing - {one.module for one in BENCHMARKS.values()} == {
        "scenes.ring_design",
        "accuracy.nail_fit",
        "robot.frame_source",  # these three are processes of the loads
        "robot.gateway_load",
        "gateway.bare_route",
    }
