"""What a room shows of itself: the newest of everything, and nothing that names a patient."""

from shared.bus.exporter import REPEAT_EVERY_S, Reporting
from shared.bus.room_view import RobotGlance, RoomView
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext
from shared.messages.presence import ServiceStatus
from shared.messages.refusals import BusRefusals
from shared.messages.robot import RobotState
from shared.messages.site import RoomSummary
from shared.robot_states import MotionState, StopLatch

STATUS = ServiceStatus(service="robot", boot_epoch="b", version="0.1.0", condition="ready", sent_at_ns=1)


def robot(state: MotionState = MotionState.LOCKED, sequence: int = 1) -> RobotGlance:
    whole = RobotState(
        boot_epoch="b",
        sequence=sequence,
        sent_at_ns=1,
        state=state,
        stop=StopLatch.CLEAR,
        locked=state is MotionState.LOCKED,
        referenced=True,
        pose=None,
        leg_lengths_mm=None,
        pivot_mm=(0.0, 0.0, 0.0),
        hexapod_sha256="0" * 64,
    )
    return RobotGlance.model_validate_json(encode(whole))


def view() -> RoomView:
    return RoomView("or1", "epoch")


class Published:
    def __init__(self) -> None:
        self.messages: list[RoomSummary] = []

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        assert attachment == b""
        self.messages.append(decode(RoomSummary, payload))

    def close(self) -> None:
        """Nothing to take back."""


def test_a_room_of_which_nothing_is_known_says_so() -> None:
    summary = view().summary(1.0, link_up=True)
    assert (summary.robot, summary.case_id) == (None, None)
    assert {(one.alive, one.condition) for one in summary.services} == {(False, "unknown")}


def test_the_newest_of_each_message_is_shown() -> None:
    room = view()
    room.note_status(STATUS)
    room.note_alive("robot", alive=True)
    room.note_robot(robot(), 10.0)
    room.note_robot(robot(MotionState.MOVING, 2), 11.0)
    room.note_refusals(
        BusRefusals(router_epoch="r", messages_denied=2, links_refused=1, unknown_names=0, gaps=0, newest=())
    )
    summary = room.summary(11.5, link_up=True)
    assert summary.robot is not None
    assert (summary.robot.state, summary.robot.age_s) == (MotionState.MOVING, 0.5)
    service = next(one for one in summary.services if one.service == "robot")
    assert (service.alive, service.condition, service.version) == (True, "ready", "0.1.0")
    assert (summary.messages_denied, summary.links_refused) == (2, 1)


def test_of_a_case_only_its_id_leaves_the_room() -> None:
    room = view()
    room.note_case(CaseContext(case_id="case-1", revision=1, side="right", nail_json='{"name": "nail"}'))
    shown = room.summary(1.0, link_up=True).model_dump_json()
    assert "case-1" in shown
    assert "right" not in shown
    assert "nail" not in shown


def test_a_change_is_published_at_once_and_a_room_at_rest_once_a_second() -> None:
    room, published, now = view(), Published(), [100.0]
    reporting = Reporting(room, published, lambda: now[0])
    room.note_robot(robot(), 100.0)
    assert reporting.look(link_up=True)
    now[0] += 0.2
    assert not reporting.look(link_up=True), "only the age of the state has changed"
    room.note_robot(robot(MotionState.FAULT, 2), now[0])
    assert reporting.look(link_up=True)
    now[0] += REPEAT_EVERY_S
    assert reporting.look(link_up=True)
    assert [one.sequence for one in published.messages] == [0, 1, 2]


def test_a_room_whose_router_has_gone_says_so() -> None:
    room, published = view(), Published()
    reporting = Reporting(room, published, lambda: 1.0)
    reporting.look(link_up=True)
    assert reporting.look(link_up=False)
    assert [one.link_up for one in published.messages] == [True, False]
