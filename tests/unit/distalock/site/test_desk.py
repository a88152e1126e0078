"""What a control desk makes of summaries: which room needs somebody, and why."""

import pytest

from distalock.site.desk import SILENT_AFTER_S, Desk, SeenRoom
from shared.bus.access import SERVICES
from shared.bus.port import Sample
from shared.bus.site import summary_key
from shared.messages.base import encode
from shared.messages.site import RobotSummary, RoomSummary, ServiceSummary
from shared.robot_states import MotionState, StopLatch

ROBOT = RobotSummary(state=MotionState.LOCKED, stop=StopLatch.CLEAR, locked=True, age_s=0.0)
WELL = RoomSummary(
    room="or1",
    exporter_epoch="e",
    sequence=1,
    link_up=True,
    services=tuple(ServiceSummary(service=name, alive=True, condition="ready") for name in SERVICES),
    robot=ROBOT,
    case_id=None,
)
FAULT = ROBOT.model_copy(update={"state": MotionState.FAULT, "detail": "a brake slips"})


def with_service(number: int, **changes: object) -> RoomSummary:
    services = list(WELL.services)
    services[number] = services[number].model_copy(update=changes)
    return WELL.model_copy(update={"services": tuple(services)})


def test_a_room_that_is_well_needs_nobody() -> None:
    assert SeenRoom(WELL, 1.0).why_attention == ""


@pytest.mark.parametrize(
    ("summary", "why"),
    [
        (WELL.model_copy(update={"link_up": False}), "its exporter does not reach its router"),
        (with_service(0, alive=False), f"not there: {SERVICES[0]}"),
        (with_service(1, condition="degraded", detail="disk nearly full"), f"{SERVICES[1]} degraded: disk nearly full"),
        (WELL.model_copy(update={"robot": None}), "nothing is known of its robot"),
        (WELL.model_copy(update={"robot": FAULT}), "robot: a brake slips"),
    ],
)
def test_a_room_that_is_not_well_says_why(summary: RoomSummary, why: str) -> None:
    assert SeenRoom(summary, 1.0).why_attention == why


def test_silence_goes_before_everything_that_was_said_before_it() -> None:
    assert SeenRoom(WELL.model_copy(update={"robot": FAULT}), SILENT_AFTER_S + 1.0).why_attention == "silent for 4 s"


def test_a_desk_keeps_the_newest_of_each_room() -> None:
    desk = Desk()
    for room, sequence in (("or2", 1), ("or1", 1), ("or2", 2)):
        summary = WELL.model_copy(update={"room": room, "sequence": sequence})
        desk.on_sample(Sample(summary_key(room), encode(summary), b""))
    assert [(one.summary.room, one.summary.sequence) for one in desk.rooms()] == [("or1", 1), ("or2", 2)]
    assert len(desk.taken()) == 3
    assert desk.taken() == []
