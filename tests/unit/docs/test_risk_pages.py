"""The risk file agrees with itself, with the marks of tests, and with the folders that there are."""

from tools.risk.check import gaps
from tools.risk.evidence import ROOT, marked_tests
from tools.risk.files import load_risk_file


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
