"""Procedures of the campaign that end as nobody meant them to."""

from typing import NoReturn

from benchmarks.campaign.case_entry import opened_with, set_up
from benchmarks.campaign.play import play
from benchmarks.campaign.procedure import Procedure
from benchmarks.campaign.rows import Ending
from benchmarks.campaign.troubles import troubles_of
from simulation.scenario.sampling import scenario_of_seed

# Its head extension is misread as 82 mm; the scale ends at 80 mm.
_BEYOND_THE_SCALE = 90046


def _failing(_: Procedure) -> NoReturn:
    raise ZeroDivisionError("of nothing")


def test_an_error_that_nobody_foresaw_is_a_row_with_a_seed() -> None:
    """A long run goes on after it, and its page names it."""
    row = play(_BEYOND_THE_SCALE, _failing)
    assert row.ending is Ending.CRASHED
    assert row.why.startswith("crashed: ZeroDivisionError in test_play.py:")
    assert row.error == troubles_of(_BEYOND_THE_SCALE).error.value
    assert row.harms == ()


def _harmed_and_failing(procedure: Procedure) -> NoReturn:
    procedure.people.watch.harms.append("unheld: for the test")
    raise ZeroDivisionError("of nothing")


def test_what_harmed_before_an_error_counts_as_harm() -> None:
    row = play(_BEYOND_THE_SCALE, _harmed_and_failing)
    assert row.ending is Ending.HARM
    assert row.harms == ("unheld: for the test",)
    assert row.why.startswith("crashed: ZeroDivisionError")


def test_an_entry_beyond_the_scale_is_refused_when_the_case_is_opened() -> None:
    """People learn what they sent, the limit and what to do; the case is opened with what the scale says."""
    scenario = scenario_of_seed(_BEYOND_THE_SCALE)
    body, refused = opened_with(scenario, troubles_of(_BEYOND_THE_SCALE))
    assert refused.startswith("head_extension_mm is 82.4757 (limit: at most 80); read it off the scale")
    assert body == set_up(scenario, None)
    assert body.head_extension_mm == scenario.head_extension_mm
