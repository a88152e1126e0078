"""The campaign's page and its frequencies say what the rows say."""

from dataclasses import replace

from benchmarks.campaign.campaign import story
from benchmarks.campaign.fmea_counts import counts_of
from benchmarks.campaign.page import page
from benchmarks.campaign.rows import CaseRow, DrilledHole, Ending, Moment, Noticed
from benchmarks.campaign.troubles import Error, troubles_of
from simulation.controller.faults import Fault
from tools.risk.files import FOLDER, FailureMode, entries

RIGHT = CaseRow(
    seed=7,
    error="",
    error_at="",
    image="",
    fault="",
    fault_at="",
    ending=Ending.DRILLED,
    why="",
    noticed=(),
    harms=(),
    holes=(DrilledHole("distal", 0.2, 0.3, passed=True, allowed=True, slipped=False),),
    images=3,
    moves=1,
    stops=0,
    took_s=4.0,
)
SIDE = Noticed(Moment.PLAN, "laterality_mismatch", "the case is of the left side")
REFUSED = replace(
    RIGHT,
    seed=8,
    error=Error.WRONG_SIDE.value,
    ending=Ending.REFUSED,
    why="laterality_mismatch: the case is of the left side",
    noticed=(SIDE, SIDE),
    holes=(),
)
HARMED = replace(RIGHT, seed=9, ending=Ending.HARM, harms=("wrong axis: 'distal' is off by 2.00 mm and 0.10°",))


def test_without_harm_the_page_states_what_that_excludes() -> None:
    text = page([RIGHT, REFUSED], 7)
    assert "No harm: at 95 % its probability in such a procedure is below 150.0 %" in text
    assert "| drilled right | 1 | 50.0 % |" in text
    assert "| `laterality_mismatch` | 1 | the case is of the left side (seed 8) |" in text


def test_every_harm_is_named_with_its_seed() -> None:
    text = page([RIGHT, HARMED], 7)
    assert "| 9 |  |  |  | wrong axis: 'distal' is off by 2.00 mm and 0.10° |" in text
    assert "No harm" not in text
    assert "HARM wrong axis: 'distal' is off by 2.00 mm and 0.10°" in story(HARMED)


def test_frequencies_count_procedures_and_not_refusals() -> None:
    counts = counts_of([RIGHT, REFUSED, HARMED])
    assert counts["procedures"] == 3
    assert counts["steps"][Moment.PLAN.value] == {"procedures": 1, "codes": {"laterality_mismatch": 1}}
    assert counts["errors"][Error.WRONG_SIDE.value] == {"refused": 1}


def test_what_the_fmea_says_was_tried_can_be_drawn() -> None:
    tried = {name for mode in entries(FOLDER / "fmea.yaml", FailureMode) for name in mode.tried}
    assert tried <= {*map(str, Error), *map(str, Fault)}


def test_every_kind_of_trouble_is_drawn_and_a_seed_draws_the_same_again() -> None:
    drawn = [troubles_of(seed) for seed in range(400)]
    assert {one.error for one in drawn} == set(Error)
    assert troubles_of(17) == troubles_of(17)
    assert 0.2 < sum(one.fault is not None for one in drawn) / len(drawn) < 0.4
