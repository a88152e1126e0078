"""Guidance on an in-memory bus: every frame of a run speaks, and only its newest is localised in full."""

import queue
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Method, localise
from services.registration.frames import LocalisedFrame, OpenCase, ReceivedFrame
from services.registration.knowledge import Knowledge
from services.registration.live import LiveGuidance
from services.registration.report import localisation_message
from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus
from shared.errors import Reason, ReasonCode
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage, decode, encode
from shared.messages.cases import CaseContext
from shared.messages.guidance import Guidance
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader, ImageReference
from shared.messages.registration import LocalisationRecord
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState, StopLatch
from shared.parts.files import sha256_of
from shared.runtime.lifecycle import open_service
from tests.unit.services.registration.outside import BLANK, KEYS, PATIENCE_S, eventually, header, reference
from tests.unit.services.registration.rendered_case import (
    GUIDE_JSON,
    HEXAPOD_JSON,
    NAIL_JSON,
    RING_JSON,
    SIZE_PX,
    Shown,
    rendered,
    rendered_parts,
    turned_nail,
)
from tests.unit.services.registration.test_plan_axes import TIMES


@dataclass
class CArm:
    """Imaging as registration hears it, and what registration says."""

    bus: Bus
    words: "queue.Queue[Guidance]"
    records: "queue.Queue[LocalisationRecord]"
    knowledge: Knowledge
    sequence: int = 0

    def shows(self, pixels: NDArray[np.float32], calibration: CArmCalibration | None, at_s: float) -> int:
        """An image arrives with its calibration; its number."""
        self.sequence += 1
        sha256, received_ns = sha256_of(str(self.sequence).encode()), int(1e9 * at_s)
        header = FrameHeader(
            sha256=sha256,
            sop_instance_uid="1.2.3",
            sequence=self.sequence,
            boot_epoch="imaging-1",
            received_at_ns=received_ns,
            width_px=SIZE_PX,
            height_px=SIZE_PX,
            bits_stored=16,
            case_id="case-1",
            case_revision=1,
            nominal_source_to_detector_mm=1000.0,
            nominal_pixel_mm=0.235,
            positioner_primary_angle_deg=85.0,
            positioner_secondary_angle_deg=3.0,
        )
        message = CalibrationMessage(
            image=ImageReference(
                sha256=sha256, sop_instance_uid="1.2.3", sequence=self.sequence, received_at_ns=received_ns
            ),
            case_id="case-1",
            case_revision=1,
            ring_sha256=sha256_of(RING_JSON.encode()),
            software_version="0",
            verdict="rejected" if calibration is None else "accepted",
            reasons=() if calibration else (ReasonMessage(code=ReasonCode.RING_NOT_FOUND, message="no ring; show it"),),
            values=None if calibration is None else CalibrationValues.of(calibration),
            elapsed_ms=10.0,
        )
        self.bus.publisher(KEYS.frame).put(np.ascontiguousarray(pixels, dtype="<f4").tobytes(), encode(header))
        self.bus.retained_publisher(KEYS.calibration).put(encode(message))
        return self.sequence

    def robot_rests_at(self, x_mm: float) -> None:
        """The robot is heard of, and stands somewhere."""
        state = RobotState(
            boot_epoch="robot-1",
            sequence=1,
            sent_at_ns=0,
            state=MotionState.LOCKED,
            stop=StopLatch.CLEAR,
            locked=True,
            referenced=True,
            pose=PlatformPoseMessage(x_mm=x_mm, y_mm=0.0, z_mm=0.0, u_deg=0.0, v_deg=0.0, w_deg=0.0),
            leg_lengths_mm=None,
            pivot_mm=(0.0, 0.0, 0.0),
            hexapod_sha256=sha256_of(HEXAPOD_JSON.encode()),
        )
        self.bus.retained_publisher(KEYS.robot_state).put(encode(state))
        eventually(lambda: self.knowledge.robot == state)

    def next_word(self) -> Guidance:
        return self.words.get(timeout=PATIENCE_S)


@pytest.fixture
def c_arm() -> Iterator[CArm]:
    router = MemoryRouter()
    settings = RegistrationSettings(live_check_every_s=600.0)
    knowledge = Knowledge("registration-1", settings.kept_images, settings.image_delay_s, lambda: 100.0)
    with router.open() as bus:
        seen = CArm(bus, queue.Queue(), queue.Queue(), knowledge)
        bus.subscribe(KEYS.guidance, lambda s: seen.words.put(decode(Guidance, s.payload)))
        bus.subscribe(KEYS.localisation, lambda s: seen.records.put(decode(LocalisationRecord, s.payload)))
        bus.retained_publisher(KEYS.case_context).put(encode(context()))
        with (
            open_service("registration", settings, lambda _: router.open()) as (own, runtime),
            RegistrationService(own, runtime, settings, knowledge).running(),
        ):
            yield seen
            runtime.stop.set()


def test_a_shot_is_localised_and_the_frames_after_it_are_followed(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    shot = c_arm.shows(pixels, calibration, at_s=10.0)
    word = c_arm.next_word()
    assert (word.image.sequence, word.origin, word.verdict) == (shot, "localised", "accepted")
    assert c_arm.records.get(timeout=PATIENCE_S).image.sequence == shot

    for number in range(3):
        frame = c_arm.shows(pixels, calibration, at_s=10.1 + 0.1 * number)
        word = c_arm.next_word()
        assert (word.image.sequence, word.origin, word.verdict) == (frame, "followed", "accepted"), word.reasons
        assert word.holes is not None
        assert {hole.id for hole in word.holes} == {"distal", "proximal"}
        assert word.standard_uncertainty_deg is not None
        assert word.mirror_check is not None
        assert word.mirror_check.frames_ago == number + 1

    # the run has ended: its last frame, and none of those before, is localised in full
    assert c_arm.records.get(timeout=PATIENCE_S).image.sequence == frame
    assert c_arm.records.empty()


def test_a_frame_that_could_not_be_calibrated_repeats_nothing_of_the_one_before(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    c_arm.shows(pixels, calibration, at_s=10.0)
    assert c_arm.next_word().verdict == "accepted"
    frame = c_arm.shows(BLANK, None, at_s=10.1)
    word = c_arm.next_word()
    assert (word.image.sequence, word.verdict) == (frame, "rejected")
    assert [reason.code for reason in word.reasons] == [ReasonCode.RING_NOT_FOUND]
    assert (word.holes, word.c_arm_correction_deg, word.standard_uncertainty_deg) == (None, None, None)


def test_a_run_without_a_key_says_that_it_waits(c_arm: CArm) -> None:
    c_arm.shows(BLANK, None, at_s=10.0)
    assert c_arm.records.get(timeout=PATIENCE_S).localisation.verdict == "rejected"
    _, calibration = still_picture()
    frame = c_arm.shows(BLANK, calibration, at_s=10.1)
    word = c_arm.next_word()
    assert (word.image.sequence, word.verdict) == (frame, "rejected")
    assert "hold the C-arm still" in word.reasons[0].message


def test_a_key_is_worth_nothing_once_the_robot_has_moved(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    c_arm.shows(pixels, calibration, at_s=10.0)
    assert c_arm.next_word().verdict == "accepted"
    c_arm.robot_rests_at(x_mm=0.3)
    c_arm.shows(pixels, calibration, at_s=10.1)
    word = c_arm.next_word()
    assert (word.verdict, word.origin) == ("rejected", "followed")
    assert "hold the C-arm still" in word.reasons[0].message


@dataclass
class Lone:
    """Guidance alone, handed images and what a full localisation found in them."""

    guidance: LiveGuidance
    knowledge: Knowledge
    words: "queue.Queue[Guidance]"

    def arrives(self, name: str, at_s: float, revision: int = 1) -> None:
        """An image with its pixels and its calibration."""
        pixels, calibration = still_picture()
        head = header(name).model_copy(update={"received_at_ns": int(1e9 * at_s), "case_revision": revision})
        self.knowledge.note_frame(head, pixels)
        self.guidance.takes(
            CalibrationMessage(
                image=reference(name).model_copy(update={"received_at_ns": int(1e9 * at_s)}),
                case_id="case-1",
                case_revision=revision,
                ring_sha256=sha256_of(RING_JSON.encode()),
                software_version="0",
                verdict="accepted",
                reasons=(),
                values=CalibrationValues.of(calibration),
                elapsed_ms=10.0,
            )
        )

    def localised(self, name: str, found: LocalisationResult) -> None:
        """An image has been localised in full."""
        pixels, calibration = still_picture()
        record = LocalisationRecord(
            localisation=localisation_message(found, calibration, sha256_of(name.encode()), TIMES),
            image=reference(name),
            case_id="case-1",
            case_revision=1,
            registration_epoch="registration-1.1",
            robot_boot_epoch=None,
            robot_pose=None,
            ring_sha256="a" * 64,
            guide_sha256="b" * 64,
            nail_sha256="c" * 64,
            software_version="0",
        )
        frame = ReceivedFrame(header(name), pixels, "registration-1.1", None)
        case = OpenCase.of(context())
        self.guidance.note_localised(LocalisedFrame(frame, case, record, calibration, found))

    def next_word(self) -> Guidance:
        return self.words.get(timeout=PATIENCE_S)


def context(revision: int = 1) -> CaseContext:
    return CaseContext(
        case_id="case-1",
        revision=revision,
        ring_json=RING_JSON,
        guide_json=GUIDE_JSON,
        nail_json=NAIL_JSON,
        hexapod_json=HEXAPOD_JSON,
    )


@cache
def still_picture() -> tuple[NDArray[np.float32], CArmCalibration]:
    return rendered(Shown(), seed=1)


@cache
def found_in_full() -> LocalisationResult:
    return localise(*still_picture(), rendered_parts(), Method.MODEL, lambda _: None)


@pytest.fixture
def lone() -> Iterator[Lone]:
    router, settings = MemoryRouter(), RegistrationSettings(live_check_every_s=600.0)
    knowledge = Knowledge("registration-1", settings.kept_images, settings.image_delay_s, lambda: 100.0)
    knowledge.open_case(OpenCase.of(context()))
    words: queue.Queue[Guidance] = queue.Queue()
    with router.open() as bus, open_service("registration", settings, lambda _: router.open()) as (own, runtime):
        bus.subscribe(KEYS.guidance, lambda s: words.put(decode(Guidance, s.payload)))
        guidance = LiveGuidance(own, runtime, settings, knowledge)
        with guidance.running():
            yield Lone(guidance, knowledge, words)
        runtime.stop.set()


def followed_after_a_shot(lone: Lone) -> Guidance:
    """The word of frame `b`, which came after the shot `a`."""
    lone.arrives("a", 10.0)
    lone.localised("a", found_in_full())
    assert lone.next_word().origin == "localised"
    lone.arrives("b", 10.1)
    word = lone.next_word()
    assert (word.origin, word.verdict) == ("followed", "accepted"), word.reasons
    return word


def test_a_full_localisation_that_contradicts_guidance_is_told_at_once(lone: Lone) -> None:
    before = followed_after_a_shot(lone)
    found = found_in_full()
    assert found.nail is not None
    turned = replace(found.nail, camera_from_nail=turned_nail((6.0, 0.0)))
    lone.localised("b", replace(found, nail=turned))
    word = lone.next_word()
    assert (word.origin, word.verdict, word.image.sha256) == ("localised", "accepted", before.image.sha256)
    assert word.holes is not None
    assert before.holes is not None
    assert abs(word.holes[0].about_image_x - before.holes[0].about_image_x) > 2.0


def test_an_image_that_was_followed_and_cannot_be_localised_takes_its_word_back(lone: Lone) -> None:
    before = followed_after_a_shot(lone)
    lost = Reason(ReasonCode.NAIL_MODEL_MISMATCH, "1 bent nail found (0 allowed); take another image")
    lone.localised("b", replace(found_in_full(), reasons=(lost,)))
    word = lone.next_word()
    assert (word.origin, word.verdict, word.image.sha256) == ("localised", "rejected", before.image.sha256)
    assert [reason.code for reason in word.reasons] == [ReasonCode.NAIL_MODEL_MISMATCH]
    lone.arrives("c", 10.2)
    assert "hold the C-arm still" in lone.next_word().reasons[0].message


def test_a_localisation_of_a_set_up_that_was_left_begins_nothing(lone: Lone) -> None:
    lone.arrives("a", 10.0)
    lone.knowledge.open_case(OpenCase.of(context(revision=2)))
    lone.localised("a", found_in_full())
    lone.arrives("b", 10.1, revision=2)
    word = lone.next_word()
    assert (word.image.sha256, word.case_revision, word.verdict) == (sha256_of(b"b"), 2, "rejected")
    assert "hold the C-arm still" in word.reasons[0].message


def test_a_localisation_that_took_long_is_not_told_after_a_newer_frame(lone: Lone) -> None:
    """Even when the wall clock was set back between the two images."""
    followed_after_a_shot(lone)
    lone.arrives("old", 10.15)
    assert lone.next_word().image.sha256 == sha256_of(b"old")
    lone.arrives("set back", 3.0)
    assert lone.next_word().image.sha256 == sha256_of(b"set back")
    found = found_in_full()
    assert found.nail is not None
    lone.localised("old", replace(found, nail=replace(found.nail, camera_from_nail=turned_nail((6.0, 0.0)))))
    lone.arrives("last", 3.1)
    assert lone.next_word().image.sha256 == sha256_of(b"last")
