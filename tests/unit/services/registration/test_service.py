"""The service on an in-memory bus: every image of an open case brings a record, and plans follow the newest only."""

import base64
import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from services.registration.knowledge import Knowledge
from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Answer, Bus
from shared.errors import NoReply, ReasonCode
from shared.messages.base import ReasonMessage, WireModel, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader, ImageReference
from shared.messages.registration import (
    LocalisationRecord,
    Plan,
    PlanReply,
    PlanRequest,
    RegistrationEpoch,
    VerificationReply,
    VerificationRequest,
)
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState, StopLatch
from shared.parts.files import sha256_of
from shared.parts.hexapod_file import hexapod_from_json
from shared.runtime.lifecycle import open_service
from tests.unit.services.registration.rendered_case import (
    GUIDE_JSON,
    HEXAPOD_JSON,
    NAIL_JSON,
    RING_JSON,
    SIZE_PX,
    Shown,
    rendered,
)

PATIENCE_S = 120.0
KEYS = Keys("or1")
CASE = "case-1"
HOME = PlatformPoseMessage(x_mm=0.0, y_mm=0.0, z_mm=0.0, u_deg=0.0, v_deg=0.0, w_deg=0.0)
BLANK = np.ones((SIZE_PX, SIZE_PX), dtype=np.float32)


@dataclass
class Clock:
    """Registration's clock."""

    now_s: float = 100.0


@dataclass
class Outside:
    """The other services, as far as registration sees them."""

    bus: Bus
    knowledge: Knowledge
    records: "queue.Queue[LocalisationRecord]"
    plans: "queue.Queue[Plan]"
    clock: Clock

    def open_case(self, revision: int = 1, nail_json: str = NAIL_JSON, case_id: str | None = CASE) -> None:
        context = CaseContext(
            case_id=case_id,
            revision=revision,
            ring_json=RING_JSON,
            guide_json=GUIDE_JSON,
            nail_json=nail_json,
            hexapod_json=HEXAPOD_JSON,
        )
        self.bus.retained_publisher(KEYS.case_context).put(encode(context))

    def robot_rests(self, pose: PlatformPoseMessage = HOME) -> None:
        """It is locked, and has been for longer than any image takes to arrive."""
        self.robot_is(pose=pose)
        self.clock.now_s += 1.0

    def robot_is(self, state: MotionState = MotionState.LOCKED, pose: PlatformPoseMessage = HOME) -> None:
        message = RobotState(
            boot_epoch="robot-1",
            sequence=1,
            sent_at_ns=0,
            state=state,
            stop=StopLatch.CLEAR,
            locked=state is MotionState.LOCKED,
            referenced=True,
            pose=pose,
            leg_lengths_mm=None,
            pivot_mm=(0.0, 0.0, 0.0),
            hexapod_sha256=hexapod_from_json(HEXAPOD_JSON.encode()).sha256,
        )
        self.bus.retained_publisher(KEYS.robot_state).put(encode(message))
        eventually(lambda: self.knowledge.robot == message)

    def frame(self, name: str, pixels: np.ndarray[tuple[int, ...], np.dtype[np.float32]] = BLANK) -> None:
        payload = np.ascontiguousarray(pixels, dtype="<f4").tobytes()
        self.bus.publisher(KEYS.frame).put(payload, encode(header(name)))

    def calibrated(self, name: str, values: CalibrationValues | None, revision: int = 1) -> None:
        reasons = () if values else (ReasonMessage(code=ReasonCode.RING_NOT_FOUND, message="no ring; show it"),)
        message = CalibrationMessage(
            image=reference(name),
            case_id=CASE,
            case_revision=revision,
            ring_sha256=sha256_of(RING_JSON.encode()),
            software_version="0",
            verdict="accepted" if values else "rejected",
            reasons=reasons,
            values=values,
            elapsed_ms=10.0,
        )
        self.bus.retained_publisher(KEYS.calibration).put(encode(message))

    def ask_plan(self, name: str, hole_ids: tuple[str, ...] = ("distal", "proximal")) -> PlanReply:
        request = PlanRequest(case_id=CASE, image_sha256=sha256_of(name.encode()), hole_ids=hole_ids)
        return decode(PlanReply, self._ask(KEYS.plan_request, request))

    def ask_verification(self, *names: str) -> VerificationReply:
        request = VerificationRequest(case_id=CASE, image_sha256=tuple(sha256_of(n.encode()) for n in names))
        return decode(VerificationReply, self._ask(KEYS.verification_request, request))

    def _ask(self, key: str, request: WireModel) -> bytes:
        return self.bus.query(key, encode(request), PATIENCE_S).payload

    def next_record(self) -> LocalisationRecord:
        return self.records.get(timeout=PATIENCE_S)


def header(name: str) -> FrameHeader:
    return FrameHeader(
        sha256=sha256_of(name.encode()),
        sop_instance_uid="1.2.3",
        sequence=1,
        boot_epoch="imaging-1",
        received_at_ns=1,
        width_px=SIZE_PX,
        height_px=SIZE_PX,
        bits_stored=16,
        case_id=CASE,
        case_revision=1,
        nominal_source_to_detector_mm=1000.0,
        nominal_pixel_mm=0.235,
    )


def reference(name: str) -> ImageReference:
    return ImageReference(sha256=sha256_of(name.encode()), sop_instance_uid="1.2.3", sequence=1, received_at_ns=1)


@pytest.fixture
def outside() -> Iterator[Outside]:
    router = MemoryRouter()
    settings = RegistrationSettings(frame_timeout_s=5.0)
    clock = Clock()
    knowledge = Knowledge("registration-1", settings.kept_images, settings.image_delay_s, lambda: clock.now_s)
    with router.open() as bus:
        known = Outside(bus, knowledge, queue.Queue(), queue.Queue(), clock)
        bus.subscribe(KEYS.localisation, lambda s: known.records.put(decode(LocalisationRecord, s.payload)))
        bus.subscribe(KEYS.plan, lambda s: known.plans.put(decode(Plan, s.payload)))
        with (
            open_service("registration", settings, lambda _: router.open()) as (own, runtime),
            RegistrationService(own, runtime, settings, knowledge).running(),
        ):
            yield known
            runtime.stop.set()


def eventually(condition: Callable[[], bool]) -> None:
    """Ask again until it holds: for effects that announce themselves only in answers."""
    pause = threading.Event()
    for _ in range(1000):
        if condition():
            return
        pause.wait(0.01)
    raise AssertionError("never came true")


def test_an_accepted_image_is_planned_and_verified(outside: Outside) -> None:
    pixels, view = rendered(Shown(), seed=1)
    outside.robot_rests()
    outside.open_case()
    outside.frame("one", pixels)
    outside.calibrated("one", CalibrationValues.of(view))
    record = outside.next_record()
    assert record.localisation.verdict == "accepted", record.localisation.reasons
    assert record.robot_pose == HOME
    assert record.nail_sha256 == sha256_of(NAIL_JSON.encode())
    assert base64.b64decode(record.overlay_png_base64 or "").startswith(b"\x89PNG")

    reply = outside.ask_plan("one")
    assert reply.verdict == "accepted", reply.message
    assert reply.plan is not None
    assert outside.plans.get(timeout=PATIENCE_S).sha256() == reply.plan.sha256()
    assert reply.plan.registration_epoch == record.registration_epoch
    assert reply.plan.start_pose == HOME
    assert all(hole.chance_to_pass > 0.9 for hole in reply.plan.predicted)
    assert outside.ask_plan("one", ("middle",)).code == "unknown_hole"

    verification = outside.ask_verification("one").verification
    assert verification is not None
    assert {hole.id for hole in verification.guide_holes} == {"distal", "proximal"}
    assert [reason.code for reason in verification.reasons] == [ReasonCode.WIRE_NOT_FOUND] * 2
    assert outside.ask_verification("one", "one").code == "image_twice"

    outside.robot_is(pose=HOME.model_copy(update={"x_mm": 0.5}))
    eventually(lambda: outside.ask_plan("one").code == "stale")
    outside.robot_is(MotionState.MOVING)
    eventually(lambda: outside.ask_plan("one").code == "robot_unknown")
    outside.robot_is()
    eventually(lambda: outside.ask_plan("one").verdict == "accepted")
    outside.frame("two")
    eventually(lambda: outside.ask_plan("one").code == "stale")
    outside.open_case(revision=2)
    eventually(lambda: outside.ask_verification("one").code == "unknown_image")


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


def test_every_image_begins_an_epoch(outside: Outside) -> None:
    outside.open_case()
    epochs = []
    for name in ("one", "two"):
        outside.frame(name)
        outside.calibrated(name, None)
        epochs.append(outside.next_record().registration_epoch)
    assert len(set(epochs)) == 2


@pytest.mark.parametrize(
    ("moved_to", "rested_s", "bound"),
    [(HOME, 0.6, True), (HOME, 0.4, False), (HOME.model_copy(update={"w_deg": 0.02}), 0.4, False)],
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


def test_an_image_that_arrives_during_a_move_binds_no_pose(outside: Outside) -> None:
    outside.robot_rests()
    outside.robot_is(MotionState.MOVING)
    outside.clock.now_s += 60.0
    outside.open_case()
    outside.frame("one")
    outside.calibrated("one", None)
    assert outside.next_record().robot_pose is None


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
    assert next_epoch(seen) == outside.knowledge.epoch


def test_an_image_whose_pixels_were_missed_begins_an_epoch_as_well(outside: Outside) -> None:
    before = outside.knowledge.epoch
    outside.calibrated("missed", None)
    eventually(lambda: outside.knowledge.epoch != before)
    assert outside.knowledge.newest_sha256 == sha256_of(b"missed")


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
