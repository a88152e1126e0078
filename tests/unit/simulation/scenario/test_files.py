"""Scenario files: what they may say, and the sentences when they say it wrongly."""

import json
from pathlib import Path

import pytest

from simulation.scenario.files import ScenarioInvalid, merged_ranges, read_scenario_file
from simulation.scenario.sampling import scenario_from_file

GOOD = {"schema": "distalock/scenario/1", "seed": 5}


def written(folder: Path, content: object) -> Path:
    file = folder / "scenario.json"
    file.write_text(json.dumps(content))
    return file


def test_a_seed_is_enough(tmp_path: Path) -> None:
    assert read_scenario_file(written(tmp_path, GOOD)).seed == 5


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({**GOOD, "colour": "red"}, "colour: Extra inputs are not permitted"),
        ({**GOOD, "seed": -1}, "seed: Input should be greater than or equal to 0"),
        ({"schema": "distalock/scenario/2", "seed": 1}, "schema"),
        ({**GOOD, "ranges": {"exposure": {"gain": [1, 2]}}}, r"exposure\.gain: Extra inputs"),
        ({**GOOD, "ranges": {"placement": {"guide_offset_mm": [8, 1]}}}, "must not run from 8 down to 1"),
        ({**GOOD, "ranges": {"weather": {}}}, "weather: Extra inputs"),
    ],
)
def test_wrong_files_are_one_sentence(tmp_path: Path, content: object, sentence: str) -> None:
    with pytest.raises(ScenarioInvalid, match=sentence):
        read_scenario_file(written(tmp_path, content))


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ScenarioInvalid, match=r"none\.json: cannot be read: No such file"):
        read_scenario_file(tmp_path / "none.json")


def test_a_file_that_is_no_json_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "scenario.json"
    file.write_bytes(b"\x89PNG")
    with pytest.raises(ScenarioInvalid, match="Invalid JSON"):
        read_scenario_file(file)


def test_an_unknown_part_is_refused_with_the_catalogue(tmp_path: Path) -> None:
    file = read_scenario_file(written(tmp_path, {**GOOD, "nail": "nail-of-wood"}))
    with pytest.raises(ScenarioInvalid, match=r"nail 'nail-of-wood': .*the catalogue has nail-"):
        scenario_from_file(file, tmp_path)


def test_a_broken_part_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.json").write_text('{"schema": "distalock/nail/1"}')
    file = read_scenario_file(written(tmp_path, {**GOOD, "nail": "mine.json"}))
    with pytest.raises(ScenarioInvalid, match=r"mine\.json: units: Field required"):
        scenario_from_file(file, tmp_path)


def test_ranges_override_one_quantity_only() -> None:
    changed, default = merged_ranges({"exposure": {"blur_px": [2.0, 2.0]}}), merged_ranges({})
    assert changed.exposure.blur_px == (2.0, 2.0)
    assert changed.exposure.tail_px == default.exposure.tail_px
    assert changed.placement == default.placement
