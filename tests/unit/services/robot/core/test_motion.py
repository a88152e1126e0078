"""The motion table over all pairs of state and event."""

from itertools import product
from pathlib import Path

import pytest

from services.robot.core.motion import (
    MEANINGS,
    REQUESTS,
    TABLE,
    Effect,
    Event,
    Transition,
    motion_table_markdown,
    next_motion,
    stop_is_latched,
)
from services.robot.core.refusals import Refusal, RefusalCode
from shared.robot_states import MotionState

ALL_PAIRS = list(product(MotionState, Event))
AT_REST = (MotionState.UNREFERENCED, MotionState.LOCKED, MotionState.STOPPED, MotionState.FAULT)
UNDER_WAY = (MotionState.MOVING, MotionState.REFERENCING)
SAFETY_PAGE = Path(__file__).parents[5] / "docs" / "safety.md"


@pytest.mark.parametrize(("state", "event"), ALL_PAIRS)
def test_the_table_is_total(state: MotionState, event: Event) -> None:
    outcome = next_motion(state, event)
    if isinstance(outcome, Refusal):
        assert event.value.replace("_", " ") in outcome.message
        assert outcome.message.endswith(("first", "cable", "it", "reset", "already"))


@pytest.mark.requirement("ROB-02")
@pytest.mark.parametrize(("state", "event"), ALL_PAIRS)
def test_moving_is_entered_from_locked_by_a_move_alone(state: MotionState, event: Event) -> None:
    outcome = next_motion(state, event)
    if isinstance(outcome, Transition) and outcome.state is MotionState.MOVING:
        assert (state, event) == (MotionState.LOCKED, Event.MOVE) or state is MotionState.MOVING
    if isinstance(outcome, Transition) and Effect.START_MOVE in outcome.effects:
        assert (state, event) == (MotionState.LOCKED, Event.MOVE)


@pytest.mark.requirement("ROB-12")
@pytest.mark.parametrize(("state", "event"), ALL_PAIRS)
def test_every_change_to_a_state_at_rest_locks(state: MotionState, event: Event) -> None:
    outcome = next_motion(state, event)
    if isinstance(outcome, Transition) and outcome.state in AT_REST and outcome.state is not state:
        assert Effect.LOCK in outcome.effects


@pytest.mark.requirement("ROB-02")
@pytest.mark.parametrize("state", list(MotionState))
def test_stop_is_legal_in_every_state_and_leaves_the_latch_in_force(state: MotionState) -> None:
    outcome = next_motion(state, Event.STOP)
    assert isinstance(outcome, Transition)
    assert Effect.STOP_NOW in outcome.effects
    assert stop_is_latched(outcome.state)


@pytest.mark.requirement("ROB-05")
@pytest.mark.parametrize(("state", "event"), ALL_PAIRS)
def test_only_a_person_releases_the_latch(state: MotionState, event: Event) -> None:
    outcome = next_motion(state, event)
    if isinstance(outcome, Transition) and stop_is_latched(state) and not stop_is_latched(outcome.state):
        assert event in (Event.ACKNOWLEDGE_REFERENCED, Event.ACKNOWLEDGE_UNREFERENCED)
        assert Effect.RELEASE_STOP in outcome.effects
    elif isinstance(outcome, Transition):
        assert Effect.RELEASE_STOP not in outcome.effects


@pytest.mark.requirement("ROB-02")
@pytest.mark.parametrize("state", UNDER_WAY)
@pytest.mark.parametrize(
    "event", [Event.STOP, Event.SUPERVISION_LOST, Event.CONTROLLER_STOPPED, Event.FAULT_SEEN, Event.SHUT_DOWN]
)
def test_every_trouble_stops_what_is_under_way(state: MotionState, event: Event) -> None:
    outcome = next_motion(state, event)
    assert isinstance(outcome, Transition)
    assert outcome.effects[:2] == (Effect.STOP_NOW, Effect.LOCK)
    assert outcome.state not in UNDER_WAY


@pytest.mark.parametrize(
    ("state", "event", "code"),
    [
        (MotionState.DISCONNECTED, Event.MOVE, RefusalCode.NOT_CONNECTED),
        (MotionState.UNREFERENCED, Event.MOVE, RefusalCode.NOT_REFERENCED),
        (MotionState.REFERENCING, Event.MOVE, RefusalCode.BUSY),
        (MotionState.MOVING, Event.MOVE, RefusalCode.BUSY),
        (MotionState.STOPPED, Event.MOVE, RefusalCode.STOP_IN_FORCE),
        (MotionState.FAULT, Event.MOVE, RefusalCode.IN_FAULT),
        (MotionState.LOCKED, Event.REFERENCE, RefusalCode.NOTHING_TO_DO),
        (MotionState.STOPPED, Event.REFERENCE, RefusalCode.STOP_IN_FORCE),
        (MotionState.FAULT, Event.ACKNOWLEDGE_REFERENCED, RefusalCode.IN_FAULT),
        (MotionState.MOVING, Event.RESET, RefusalCode.BUSY),
    ],
)
def test_requests_are_refused_with_their_code(state: MotionState, event: Event, code: RefusalCode) -> None:
    outcome = next_motion(state, event)
    assert isinstance(outcome, Refusal)
    assert outcome.code is code


def test_every_event_is_explained_and_every_request_possible_somewhere() -> None:
    assert set(MEANINGS) == set(Event)
    assert all(any(event is possible for _, possible in TABLE) for event in REQUESTS)


def test_the_safety_page_shows_the_table_as_it_is() -> None:
    assert len(motion_table_markdown().splitlines()) == 2 + len(Event)
    assert motion_table_markdown() in SAFETY_PAGE.read_text(), (
        f"docs/safety.md shows another motion table; replace it by\n\n{motion_table_markdown()}"
    )
