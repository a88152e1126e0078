"""The scenarios that the examples folder ships."""

from pathlib import Path

import pytest

from simulation.scenario.files import read_scenario_file
from simulation.scenario.imaging_values import FlatPanel
from simulation.scenario.sampling import scenario_from_file
from simulation.scenario.values import Scenario

EXAMPLES = Path(__file__).parents[4] / "examples"
FILES = sorted(EXAMPLES.glob("scenario-*.json"))


def sampled(name: str) -> Scenario:
    file = EXAMPLES / name
    return scenario_from_file(read_scenario_file(file), file.parent)


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_example_can_be_played_and_says_what_it_is(file: Path) -> None:
    read = read_scenario_file(file)
    assert read.description
    assert scenario_from_file(read, file.parent).seed == read.seed


def test_examples_are_what_they_say() -> None:
    assert len(FILES) == 4
    assert isinstance(sampled("scenario-first.json").detector, FlatPanel)
    assert sampled("scenario-first.json").head_extension_mm == 60.0
    old = sampled("scenario-mirrored-intensifier.json")
    assert (old.display.mirrored, old.display.bits, old.side) == (True, 8, "left")
