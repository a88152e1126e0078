"""How the demonstration ends where the gateway refuses what its scenario asks for."""

import pytest
from rich.console import Console

from distalock import demo
from distalock.client import RequestRefused
from distalock.demo import DemoRequest, run_demo
from distalock.procedure import Outcome, Tell


def refuse(request: DemoRequest, tell: Tell) -> Outcome:
    raise RequestRefused.of(422, "nail_of_other_bone", "made for the tibia, the case's bone is the femur")


def test_a_refused_request_ends_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "demonstrate", refuse)
    assert run_demo(DemoRequest(("--seed", "3")), Console()) == 3
    assert capsys.readouterr().err == "distalock demo: refused: made for the tibia, the case's bone is the femur\n"
