"""Which earlier images registration keeps and finds again, and that the head is never taken to be right unseen."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from services.registration.core.acceptance.criteria import HeadTrouble
from services.registration.frames import LocalisedFrame
from services.registration.planning import head_trouble
from services.registration.state import SLOW_ANSWER_S, RegistrationState
from services.robot.core.tuning import RATES
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState
from shared.parts.files import sha256_of
from tests.unit.services.registration.core.test_fusion import AMBIGUOUS, localised
from tests.unit.services.registration.outside import BLANK, HOME, PATIENCE_S, Clock, eventually, header, robot_state
from tests.unit.services.registration.test_planning import frame

AWAY = HOME.model_copy(update={"x_mm": 1.5})
JITTER = HOME.model_copy(update={"x_mm": 0.0004})


def _aside(x_mm: float) -> PlatformPoseMessage:
    return HOME.model_copy(update={"x_mm": HOME.x_mm + x_mm})


def knowing(*frames: LocalisedFrame, kept: int = 10) -> RegistrationState:
    state = RegistrationState("registration-1", kept, 0.5, lambda: 0.0)
    for one in frames:
        state.images.note(one)
    return state


def of_case(case_id: str, one: LocalisedFrame) -> LocalisedFrame:
    context = one.case.context.model_copy(update={"case_id": case_id})
    return replace(one, case=replace(one.case, context=context))


def names(frames: tuple[LocalisedFrame, ...]) -> list[str]:
    known = {sha256_of(name.encode()): name for name in "abcdefgh"}
    return [known[one.record.image.sha256] for one in frames]


def test_images_beside_another_are_accepted_ones_with_the_robot_as_far_as_encoders_can_tell_in_one_place() -> None:
    newest = frame(localised("e"))
    state = knowing(
        frame(localised("a"), JITTER),
        frame(localised("b"), AWAY),
        frame(localised("c", 0.0, 1.0, AMBIGUOUS)),
        frame(localised("d"), None),
        newest,
    )
    assert names(state.images.accepted_beside(newest)) == ["a", "e"]
    assert names(state.images.accepted_elsewhere(newest)) == ["b"]


def received(number: int, one: LocalisedFrame, store_id: str = "store-1") -> LocalisedFrame:
    image = one.record.image.model_copy(update={"sequence": number, "store_id": store_id})
    return replace(one, record=one.record.model_copy(update={"image": image}))


def test_images_before_others_were_received_before_all_of_them_as_far_as_that_is_known() -> None:
    first, second = received(3, frame(localised("c"))), received(5, frame(localised("e")))
    before, between, after = (received(n, frame(localised(name))) for n, name in ((1, "a"), (4, "d"), (6, "f")))
    state = knowing(before, received(2, frame(localised("b")), "store-2"), first, between, second, after)
    assert names(state.images.accepted_before([second, first])) == ["a"]
    assert names(state.images.accepted_before([second])) == ["a", "c", "d"]


def test_the_last_accepted_image_of_each_place_outlives_a_run() -> None:
    run = [frame(localised(name), AWAY) for name in "cdefgh"]
    state = knowing(frame(localised("a")), frame(localised("b")), *run, kept=3)
    assert names(state.images.accepted_elsewhere(run[-1])) == ["b"]
    assert state.images.get(sha256_of(b"h")) is run[-1]
    assert state.images.get(sha256_of(b"c")) is None


def test_the_newest_image_is_kept_although_all_others_are_accepted_and_of_set_ups_that_were_left() -> None:
    """An image with wires in the holes is rejected, and verified right afterwards: also in the ninth case of a day."""
    earlier = [of_case(f"case-{name}", frame(localised(name))) for name in "abc"]
    rejected = of_case("case-d", frame(localised("d", 0.0, 1.0, AMBIGUOUS)))
    state = knowing(*earlier, rejected, kept=3)
    assert state.images.get(sha256_of(b"d")) is rejected
    assert state.images.get(sha256_of(b"a")) is None


def test_the_newest_image_is_kept_although_the_robot_stood_at_a_place_of_its_own_for_each_other() -> None:
    places = [HOME.model_copy(update={"x_mm": x_mm}) for x_mm in (1.0, 2.0, 3.0)]
    rejected = frame(localised("d", 0.0, 1.0, AMBIGUOUS))
    state = knowing(
        *(frame(localised(name), place) for name, place in zip("abc", places, strict=True)), rejected, kept=3
    )
    assert state.images.get(sha256_of(b"d")) is rejected
    assert state.images.get(sha256_of(b"a")) is None


@pytest.mark.requirement("REG-09")
@pytest.mark.parametrize(
    ("age_s", "x_mm"),
    [
        (1.0, 5.0),  # received at 113 s, a second after the robot had stopped
        (1.6, None),  # received at 112.4 s, 0.4 s after that: it may have been exposed before
        (4.0, None),  # received at 110 s, before the robot moved
        (None, None),
    ],
)
def test_an_image_that_took_long_in_imaging_is_bound_by_when_it_was_received(
    age_s: float | None, x_mm: float | None
) -> None:
    clock = Clock(100.0)
    state = RegistrationState("registration-1", 10, 0.5, lambda: clock.now_s)
    state.note_robot(robot_state(MotionState.LOCKED, HOME))
    clock.now_s = 110.5
    state.note_robot(robot_state(MotionState.MOVING, HOME))
    clock.now_s = 112.0
    state.note_robot(robot_state(MotionState.LOCKED, HOME.model_copy(update={"x_mm": 5.0})))
    clock.now_s = 114.0
    robot = state.note_frame(header("late", age_s), BLANK).robot
    assert (robot and robot.pose and robot.pose.x_mm) == x_mm


def _rested() -> tuple[Clock, RegistrationState]:
    """The robot has been locked at home for ten seconds."""
    clock = Clock(100.0)
    state = RegistrationState("registration-1", 10, 0.5, lambda: clock.now_s)
    state.note_robot(robot_state(MotionState.LOCKED, HOME))
    clock.now_s = 110.0
    return clock, state


@pytest.mark.requirement("REG-09")
@pytest.mark.parametrize(
    ("meanwhile", "x_mm", "bound"),
    [
        (MotionState.LOCKED, 0.0, True),
        (MotionState.LOCKED, 0.1, False),  # it stands elsewhere
        (MotionState.MOVING, 0.0, False),  # it came back
    ],
)
def test_a_controller_that_was_slow_to_answer_did_not_end_the_robots_rest(
    meanwhile: MotionState, x_mm: float, *, bound: bool
) -> None:
    clock, state = _rested()
    state.note_robot(robot_state(meanwhile, None))
    clock.now_s += 0.3
    state.note_robot(robot_state(MotionState.LOCKED, _aside(x_mm)))
    assert (state.note_frame(header("at once"), BLANK).robot is not None) is bound
    clock.now_s += 1.2
    assert state.note_frame(header("later"), BLANK).robot is not None


@pytest.mark.requirement("REG-09")
@pytest.mark.parametrize(
    ("answer", "bound"),
    [
        (robot_state(MotionState.LOCKED, HOME), True),
        (robot_state(MotionState.LOCKED, _aside(0.1)), False),
        (robot_state(MotionState.FAULT, None), False),
        (robot_state(MotionState.LOCKED, HOME, "robot-2"), False),
    ],
)
def test_an_image_that_comes_while_the_controller_is_slow_to_answer_is_bound_by_its_answer(
    answer: RobotState, monkeypatch: pytest.MonkeyPatch, *, bound: bool
) -> None:
    monkeypatch.setattr("services.registration.state.SLOW_ANSWER_S", PATIENCE_S)
    _, state = _rested()
    state.note_robot(robot_state(MotionState.LOCKED, None))
    before, image = state.epoch, header("one")
    with ThreadPoolExecutor(1) as arrival:
        frame = arrival.submit(state.note_frame, image, BLANK)
        eventually(lambda: state.epoch != before)
        assert not frame.done()
        epoch = state.epoch
        state.note_robot(answer)
        assert (frame.result().robot is not None) is bound
    assert frame.result().epoch == epoch == state.epoch


def test_a_slow_controller_is_waited_for_until_its_robot_would_be_in_fault() -> None:
    assert RATES.silence_at_rest_s < SLOW_ANSWER_S


@pytest.mark.requirement("REG-09")
def test_an_image_is_bound_to_no_pose_when_the_controller_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.registration.state.SLOW_ANSWER_S", 0.01)
    _, state = _rested()
    state.note_robot(robot_state(MotionState.LOCKED, None))
    assert state.note_frame(header("one"), BLANK).robot is None
    assert state.epoch == "registration-1.1"


@pytest.mark.requirement("REG-09")
@pytest.mark.parametrize(("age_s", "bound"), [(0.2, True), (4.0, False)])
def test_an_image_from_before_a_restart_of_the_robot_service_is_not_bound_to_its_new_run(
    age_s: float, *, bound: bool
) -> None:
    clock = Clock(100.0)
    state = RegistrationState("registration-1", 10, 0.5, lambda: clock.now_s)
    for boot, now_s in (("robot-1", 100.0), ("robot-2", 112.0), ("robot-2", 112.1)):
        clock.now_s = now_s
        state.note_robot(robot_state(MotionState.LOCKED, HOME, boot))
    clock.now_s = 114.0
    assert (state.note_frame(header("late", age_s), BLANK).robot is not None) is bound


def test_pixels_that_come_late_are_not_the_newest() -> None:
    state = knowing()
    late, newer = header("late"), header("newer")
    state.note_announced(late.reference())
    announced = state.epoch
    state.note_announced(newer.reference())
    state.note_frame(newer, BLANK)
    now = state.epoch
    fetched = state.note_fetched_frame(late, BLANK)
    assert (fetched.epoch, fetched.robot) == (announced, None)
    newest = state.newest
    assert newest is not None
    assert (state.epoch, newest.sha256) == (now, newer.sha256)
    assert now != announced


def test_pixels_of_the_newest_image_belong_to_the_epoch_that_its_announcement_began() -> None:
    state = knowing()
    state.note_announced(header("one").reference())
    epoch = state.epoch
    assert state.note_frame(header("one"), BLANK).epoch == epoch == state.epoch
    state.note_announced(header("one").reference())
    assert state.epoch == epoch
    assert state.note_frame(header("two"), BLANK).epoch == state.epoch != epoch


def test_a_head_that_no_image_shows_is_not_taken_to_be_right() -> None:
    seen = frame(localised("a"))
    image = localised("b")
    without_nail = frame(replace(image, result=replace(seen.image.result, nail=None, holes=None)))
    refused = head_trouble(without_nail, knowing(without_nail))
    assert refused is not None
    assert refused.code is HeadTrouble.NOT_SEEN
    beside = head_trouble(without_nail, knowing(seen, without_nail))
    assert beside is None or beside.code is not HeadTrouble.NOT_SEEN
