"""The risk file agrees with itself, with the marks of tests, and with the folders that there are."""

import re

from services.ui_api.core.event_data import Step
from services.ui_api.core.procedure_table import Action
from tools.risk.check import gaps
from tools.risk.evidence import ROOT, marked_tests
from tools.risk.files import FOLDER, FailureMode, entries, load_risk_file

# What the robot's state, the gateway's steps and the campaign's people say: no refusal has these.
_OWN_CODES = {"fault", "stopped", "robot_not_ready", "doubtful", "step_out_of_order"}


def test_every_hazard_has_controls_and_every_control_has_marked_tests() -> None:
    risk, tests = load_risk_file(), marked_tests()
    assert len(risk.hazards) > 20
    assert len(tests) > 150
    assert gaps(risk, tests) == []


def test_every_source_belongs_to_a_software_item() -> None:
    paths = {path for item in load_risk_file().items for path in item.paths}
    assert all((ROOT / path).exists() for path in paths)
    sources = {file.relative_to(ROOT) for file in ROOT.glob("*/**/*.py") if file.parts[len(ROOT.parts)][0] != "."}
    homeless = {
        file.as_posix()
        for file in sources
        if not any(parent.as_posix() in paths for parent in (file, *file.parents)) and len(file.parts) > 2
    }
    assert homeless == set()


def test_every_action_and_step_of_the_procedure_has_its_failures() -> None:
    modes = entries(FOLDER / "fmea.yaml", FailureMode)
    hazards = {hazard.id for hazard in load_risk_file().hazards}
    assert {mode.step for mode in modes} == {*map(str, Action), *map(str, Step)}
    assert {mode.hazard for mode in modes} <= hazards


def test_the_codes_of_failures_are_said() -> None:
    modes = entries(FOLDER / "fmea.yaml", FailureMode)
    pages = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("refusals.md", "procedure.md"))
    said = {*re.findall(r"`(\w+)`", pages), *_OWN_CODES}
    assert {code for mode in modes for code in mode.codes} - said == set()
