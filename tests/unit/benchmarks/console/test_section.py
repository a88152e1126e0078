"""Parts of the console's page are replaced one by one, and each limit can be missed."""

import math
from collections import Counter
from pathlib import Path

from benchmarks.console import absence, axe_states, drawing, first_load, picture_time, screen_stop, setup_time
from benchmarks.console.section import HEAD, Section, with_sections

ORDER = ["First", "Second"]


def test_a_part_replaces_itself_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "console.md"
    page.write_text(with_sections(page, {"b": Section("Second", "old\n", holds=True)}, ORDER))
    page.write_text(with_sections(page, {"a": Section("First", "one\n", holds=True)}, ORDER))
    page.write_text(with_sections(page, {"b": Section("Second", "new\n", holds=True)}, ORDER))
    assert page.read_text() == f"{HEAD}## First\n\none\n\n## Second\n\nnew\n"


def test_a_violation_is_listed_and_misses_the_limit() -> None:
    looks = axe_states.Looks({"no case": [], "plan": ["label: needs one (<input>)"]})
    section = axe_states.section_of(looks)
    assert not section.holds
    assert "| plan | label: needs one (<input>) |" in section.text
    assert axe_states.section_of(axe_states.Looks({"no case": []})).holds


def test_what_no_picture_came_of_is_no_success() -> None:
    assert picture_time.section_of([50.0] * 20, [100.0] * 20).holds
    assert not picture_time.section_of([50.0] * 20, [300.0] * 20).holds
    assert not picture_time.section_of([], [100.0]).holds


def test_few_frames_and_long_tasks_miss_the_limit() -> None:
    assert drawing.section_of([drawing.Drawn("dragged", 25.0, 80.0), drawing.Drawn("first", math.nan, 0.0)]).holds
    assert not drawing.section_of([drawing.Drawn("dragged", 19.0, 0.0)]).holds
    assert not drawing.section_of([drawing.Drawn("dragged", 60.0, 101.0)]).holds


def test_an_absence_must_be_said_shown_and_overcome() -> None:
    good = absence.Absence("plan", said_s=1.5, back_s=1.0, live=(), is_same=True)
    assert absence.section_of([good]).holds
    for bad in (
        absence.Absence("plan", said_s=2.1, back_s=1.0, live=(), is_same=True),
        absence.Absence("plan", said_s=1.5, back_s=6.0, live=(), is_same=True),
        absence.Absence("plan", said_s=1.5, back_s=1.0, live=(".connection.live",), is_same=True),
        absence.Absence("plan", said_s=1.5, back_s=1.0, live=(), is_same=False),
    ):
        assert not absence.section_of([good, bad]).holds


def test_stops_count_only_if_pictures_were_shown() -> None:
    assert screen_stop.section_of({"still": [20.0] * 100}, shown=True).holds
    assert not screen_stop.section_of({"still": [20.0] * 100}, shown=False).holds
    assert not screen_stop.section_of({"still": [20.0] * 98 + [150.0] * 2}, shown=True).holds


def test_sizes_and_set_up_have_limits() -> None:
    assert first_load.section_of(Counter(js=400_000, css=6_000)).holds
    assert not first_load.section_of(Counter(js=1_000_001)).holds
    assert not first_load.section_of(Counter()).holds
    assert setup_time.section_of(30.0, 0.5).holds
    assert not setup_time.section_of(61.0, 0.5).holds
