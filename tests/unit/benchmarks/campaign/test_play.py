"""Procedures of the campaign that end as nobody meant them to."""

import pytest
from pydantic import ValidationError

from benchmarks.campaign.case_entry import set_up
from benchmarks.campaign.play import play
from benchmarks.campaign.procedure import Procedure
from benchmarks.campaign.rows import Ending
from benchmarks.campaign.troubles import troubles_of
from simulation.scenario.sampling import scenario_of_seed

# Its head extension is misread as 82 mm; the scale ends at 80 mm.
_BEYOND_THE_SCALE = 90046


def test_an_error_that_nobody_foresaw_is_a_harm_with_a_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long run goes on after it, and its page names it."""

    def fail(_: Procedure) -> str:
        raise ZeroDivisionError("of nothing")

    monkeypatch.setattr(Procedure, "run", fail)
    row = play(1)
    assert row.ending is Ending.HARM
    (harm,) = row.harms
    assert harm.startswith("crash: ZeroDivisionError in test_play.py:")


def test_an_entry_beyond_the_scale_is_refused_when_the_case_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """People learn what they sent, the limit and what to do; the case is opened with what the scale says."""
    scenario, troubles = scenario_of_seed(_BEYOND_THE_SCALE), troubles_of(_BEYOND_THE_SCALE)
    with pytest.raises(ValidationError):
        set_up(scenario, troubles)
    monkeypatch.setattr(Procedure, "_groups", lambda _: [])
    row = play(_BEYOND_THE_SCALE)
    assert [one.code for one in row.noticed] == ["invalid_request"]
    assert row.noticed[0].sentence.startswith("head_extension_mm is 82.4757 (limit: at most 80); read it off the scale")
    assert row.ending is Ending.DRILLED
