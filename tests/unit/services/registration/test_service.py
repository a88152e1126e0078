"""The service on an in-memory bus: every image of an open case brings a record, and plans follow the newest only."""

import base64
import queue
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from services.registration import image_report
from services.registration.report import timed_localisation
from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Answer
from shared.errors import NoReply, ReasonCode
from shared.messages.base import decode, encode
from shared.messages.cases import ObjectInside
from shared.messages.imaging import CalibrationValues
from shared.messages.presence import ServiceStatus
from shared.messages.registration import (
    LocalisationRecord,
    Plan,
    RegistrationEpoch,
)
from shared.messages.robot import MotionState, PlatformPoseMessage
from shared.messages.stored_images import LocalisationReply
from shared.parts.canonical import part_sha256
from shared.parts.files import sha256_of
from shared.runtime.lifecycle import open_service
from tests.unit.services.registration.outside import BLANK, HOME, KEYS, PATIENCE_S, Clock, Outside, eventually, header
from tests.unit.services.registration.rendered_case import (
    NAIL_JSON,
    Shown,
    rendered,
)


@pytest.fixture
def outside() -> Iterator[Outside]:
    router = MemoryRouter()
    settings = RegistrationSettings(frame_timeout_s=5.0)
    clock = Clock()
    state = RegistrationState("registration-1", settings.kept_images, settings.image_delay_s, lambda: clock.now_s)
    with router.open() as bus:
        known = Outside(bus, state, queue.Queue(), queue.Queue(), clock)
        bus.subscribe(KEYS.localisation, lambda s: known.records.put(decode(LocalisationRecord, s.payload)))
        bus.subscribe(KEYS.plan, lambda s: known.plans.put(decode(Plan, s.payload)))
        with (
            open_service("registration", settings, lambda _: router.open()) as (own, runtime),
            RegistrationService(own, runtime, settings, state).running(),
        ):
            yield known
            runtime.stop.set()


@pytest.mark.requirement("REG-10")
def test_an_accepted_image_is_planned_and_verified(outside: Outside, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.registration.state.SLOW_ANSWER_S", PATIENCE_S)
    pixels, view = rendered(Shown(), seed=1)
    outside.robot_rests()
    outside.open_case()
    outside.frame("one", pixels)
    outside.calibrated("one", CalibrationValues.of(view))
    record = outside.next_record()
    assert record.localisation.verdict == "accepted", record.localisation.reasons
    assert record.robot_pose == HOME
    assert record.nail_sha256 == part_sha256(NAIL_JSON.encode(), "nail")
    assert base64.b64decode(record.overlay_png_base64 or "").startswith(b"\x89PNG")

    reply = outside.ask_plan("one")
    assert reply.verdict == "accepted", reply.message
    assert reply.plan is not None
    assert outside.plans.get(timeout=PATIENCE_S).sha256() == reply.plan.sha256()
    assert reply.plan.registration_epoch == record.registration_epoch
    assert reply.plan.start_pose == HOME
    assert record.image_age_s == pytest.approx(0.2)
    assert reply.plan.image_age_s == pytest.approx(0.2)
    assert all(hole.chance_to_pass > 0.9 for hole in reply.plan.predicted)
    assert outside.ask_plan("one", ("middle",)).code == "unknown_hole"

    verification = outside.ask_verification("one").verification
    assert verification is not None
    assert {hole.id for hole in verification.guide_holes} == {"distal", "proximal"}
    assert [reason.code for reason in verification.reasons] == [ReasonCode.WIRE_NOT_FOUND] * 2
    assert outside.ask_verification("one", "one").code == "image_twice"

    outside.robot_is(pose=HOME.model_copy(update={"x_mm": 0.5}))
    eventually(lambda: outside.ask_plan("one").code == "stale")
    moved = outside.ask_verification("one")
    assert (moved.code, moved.verification) == ("stale", None)
    assert "the robot was moved by 0.500 mm" in moved.message
    outside.robot_is(MotionState.MOVING)
    eventually(lambda: outside.ask_plan("one").code == "robot_unknown")
    outside.robot_is(boot="robot-2")
    eventually(lambda: "started anew since the image was made" in outside.ask_plan("one").message)
    outside.robot_is()
    eventually(lambda: outside.ask_plan("one").verdict == "accepted")
    _assert_asked_when_the_controller_answers(outside)
    outside.clock.now_s += 600.0
    old = outside.ask_plan("one")
    assert old.code == "image_too_old"
    assert "is 600.2 s (limit 600.0 s); take one more image" in old.message
    outside.frame("two")
    eventually(lambda: outside.ask_plan("one").code == "stale")
    outside.open_case(revision=2)
    eventually(lambda: outside.ask_verification("one").code == "unknown_image")


def _assert_asked_when_the_controller_answers(outside: Outside) -> None:
    """Of a controller that is slow to answer."""
    outside.robot_is(pose=None)
    with ThreadPoolExecutor(2) as askers:
        plan, verification = askers.submit(outside.ask_plan, "one"), askers.submit(outside.ask_verification, "one")
        time.sleep(0.1)
        assert not plan.done()
        assert not verification.done()
        outside.robot_is()
        assert plan.result().verdict == "accepted"
        assert verification.result().verification is not None


def test_an_image_that_came_before_the_wires_were_known_is_verified(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    outside.next_record()
    outside.open_case(inside=(ObjectInside(kind="wire", hole_id="distal"),))
    eventually(lambda: outside.state.case is not None and bool(outside.state.case.context.inside))
    assert outside.ask_verification("one").code != "unknown_image"


def test_an_image_that_is_being_localised_is_verified_later(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    outside.calibrated("one", None)  # its pixels are waited for
    eventually(lambda: "is being localised; verify it when" in outside.ask_verification("one").message)


def test_images_with_the_robot_in_two_places_are_not_verified_together(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    outside.next_record()
    outside.robot_rests(HOME.model_copy(update={"x_mm": 0.5}))
    outside.frame("two")
    outside.calibrated("two", None)
    outside.next_record()
    reply = outside.ask_verification("one", "two")
    assert reply.code == "another_set_up"
    assert "the robot was moved by 0.500 mm" in reply.message


def test_a_rejected_calibration_is_recorded_with_its_reasons(outside: Outside) -> None:
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    record = outside.next_record()
    assert [reason.code for reason in record.localisation.reasons] == [ReasonCode.RING_NOT_FOUND]
    assert record.localisation.camera is None
    assert record.robot_pose is None
    assert outside.ask_plan("one").code == "not_accepted"


@pytest.mark.requirement("REG-10")
def test_no_plan_is_made_from_an_image_whose_age_nobody_knows(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    outside.frame("one", age_s=None)
    outside.calibrated("one", None)
    assert outside.next_record().image_age_s is None
    refused = outside.ask_plan("one")
    assert refused.code == "image_too_old"
    assert "is not known" in refused.message


def test_missed_pixels_are_fetched_and_bind_no_robot_pose(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    asked: list[str] = []

    def kept(query: object) -> Answer:
        asked.append(str(query))
        return Answer(BLANK.astype("<f4").tobytes(), encode(header("missed")))

    outside.bus.queryable(KEYS.any_frame_by_hash, kept)
    outside.calibrated("missed", None)
    record = outside.next_record()
    assert record.image.sha256 == sha256_of(b"missed")
    assert record.robot_pose is None
    assert len(asked) == 1


@pytest.mark.requirement("REG-08")
def test_every_image_begins_an_epoch(outside: Outside) -> None:
    outside.open_case()
    epochs = []
    for name in ("one", "two"):
        outside.frame(name)
        outside.calibrated(name, None)
        epochs.append(outside.next_record().registration_epoch)
    assert len(set(epochs)) == 2


@pytest.mark.requirement("REG-09")
@pytest.mark.parametrize(
    ("moved_to", "rested_s", "bound"),
    [(HOME, 0.8, True), (HOME, 0.6, False), (HOME.model_copy(update={"w_deg": 0.02}), 0.6, False)],
)
def test_an_image_that_arrives_just_after_a_move_binds_no_pose(
    outside: Outside, moved_to: PlatformPoseMessage, rested_s: float, *, bound: bool
) -> None:
    outside.robot_rests()
    outside.robot_is(MotionState.LOCKED if moved_to != HOME else MotionState.MOVING, moved_to)
    outside.robot_is(MotionState.LOCKED, moved_to)
    outside.clock.now_s += rested_s
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    assert (outside.next_record().robot_pose is not None) is bound


@pytest.mark.requirement("REG-09")
def test_an_image_that_is_sent_again_is_not_bound_to_where_the_robot_stands_by_then(outside: Outside) -> None:
    outside.robot_rests()
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    assert outside.next_record().robot_pose == HOME
    outside.robot_rests(HOME.model_copy(update={"x_mm": 5.0}))
    before = outside.state.epoch
    outside.frame("one", age_s=12.0)
    eventually(lambda: outside.state.epoch != before)  # else the calibration may find the pixels of the first time
    outside.calibrated("one", None)
    assert outside.next_record().robot_pose is None
    again = outside.ask_verification("one")
    assert again.code == "stale"
    assert "is not certain" in again.message, again.message


@pytest.mark.requirement("REG-09")
def test_an_image_that_arrives_during_a_move_binds_no_pose(outside: Outside) -> None:
    outside.robot_rests()
    outside.robot_is(MotionState.MOVING)
    outside.clock.now_s += 60.0
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    assert outside.next_record().robot_pose is None


@pytest.mark.requirement("REG-08")
def test_the_epoch_changes_before_any_image_is_understood(outside: Outside) -> None:
    words: queue.Queue[RegistrationEpoch] = queue.Queue()
    outside.bus.subscribe(KEYS.registration_epoch, lambda s: words.put(decode(RegistrationEpoch, s.payload)))

    def next_epoch(before: str) -> str:
        """The next epoch that is another; not one calibration or localisation is on its way."""
        while (epoch := words.get(timeout=PATIENCE_S).registration_epoch) == before:
            pass
        return epoch

    first = words.get(timeout=PATIENCE_S)
    second = words.get(timeout=PATIENCE_S)
    assert (second.registration_epoch, second.sequence) == (first.registration_epoch, first.sequence + 1), "steadily"
    outside.open_case()
    opened = next_epoch(first.registration_epoch)
    outside.frame("one")
    seen = next_epoch(opened)
    outside.open_case(revision=2)
    assert next_epoch(seen) == outside.state.epoch


def test_an_image_whose_pixels_were_missed_begins_an_epoch_as_well(outside: Outside) -> None:
    before = outside.state.epoch
    outside.calibrated("missed", None)
    eventually(lambda: outside.state.epoch != before)
    newest = outside.state.newest
    assert newest is not None
    assert newest.sha256 == sha256_of(b"missed")


def test_an_image_of_an_older_set_up_is_not_localised(outside: Outside) -> None:
    outside.open_case(revision=2)
    outside.frame("old")
    outside.calibrated("old", None, revision=1)
    outside.frame("new")
    outside.calibrated("new", None, revision=2)
    assert outside.next_record().image.sha256 == sha256_of(b"new")


def test_a_case_that_cannot_be_used_plans_nothing(outside: Outside) -> None:
    outside.open_case(nail_json="{}")
    assert outside.ask_plan("one").code == "no_case"
    outside.open_case()
    eventually(lambda: outside.ask_plan("one").code == "no_localisation")


def test_questions_that_are_none_bring_an_error(outside: Outside) -> None:
    with pytest.raises(NoReply, match="not a valid PlanRequest"):
        outside.bus.query(KEYS.plan_request, b"{}", PATIENCE_S)


def test_the_age_of_an_image_is_that_when_its_localisation_is_published(
    outside: Outside, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*given: object) -> object:
        outside.clock.now_s += 3.0
        return timed_localisation(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(image_report, "timed_localisation", slow)
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    assert outside.next_record().image_age_s == pytest.approx(3.2)


def test_an_image_for_which_there_was_no_memory_is_localised_when_it_is_asked_for_again(
    outside: Outside, monkeypatch: pytest.MonkeyPatch
) -> None:
    conditions: queue.Queue[ServiceStatus] = queue.Queue()
    outside.bus.subscribe_retained(
        KEYS.status("registration"), lambda s: conditions.put(decode(ServiceStatus, s.payload))
    )
    outside.open_case()
    with monkeypatch.context() as lacking:
        lacking.setattr(image_report, "timed_localisation", without_memory)
        outside.frame("one")
        outside.calibrated("one", None)
        while "waits for memory (no 2 MiB)" not in conditions.get(timeout=PATIENCE_S).detail:
            pass
    assert outside.ask_localisation("one", None) == LocalisationReply()  # it is in hand, and no fault
    assert outside.next_record().localisation.verdict == "rejected"
    while conditions.get(timeout=PATIENCE_S).condition != "ready":
        pass


def without_memory(*_: object) -> None:
    raise MemoryError("no 2 MiB")
