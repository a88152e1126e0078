"""Guidance on an in-memory bus: every frame of a run speaks, and only its newest is localised in full."""

import queue
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.service import RegistrationService
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus
from shared.errors import ReasonCode
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import ReasonMessage, decode, encode
from shared.messages.guidance import Guidance
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader
from shared.messages.registration import LocalisationRecord
from shared.messages.robot import MotionState, PlatformPoseMessage, RobotState, StopLatch
from shared.parts.canonical import part_sha256
from shared.parts.files import sha256_of
from shared.runtime.lifecycle import open_service
from tests.unit.services.registration.live_case import context, still_picture
from tests.unit.services.registration.outside import BLANK, KEYS, PATIENCE_S, eventually
from tests.unit.services.registration.rendered_case import (
    HEXAPOD_JSON,
    RING_JSON,
    SIZE_PX,
)

# on a busy machine frames that come one after another may be seconds apart
RUN_INTERVAL_S = 4.0


@dataclass
class CArm:
    """Imaging as registration hears it, and what registration says."""

    bus: Bus
    words: "queue.Queue[Guidance]"
    records: "queue.Queue[LocalisationRecord]"
    state: RegistrationState
    sequence: int = 0

    def shows(self, pixels: NDArray[np.float32], calibration: CArmCalibration | None, *, in_run: bool) -> int:
        """An image arrives with its calibration; its number."""
        self.sequence += 1
        sha256 = sha256_of(str(self.sequence).encode())
        header = FrameHeader(
            sha256=sha256,
            sop_instance_uid="1.2.3",
            sequence=self.sequence,
            boot_epoch="imaging-1",
            received_at_ns=self.sequence,
            width_px=SIZE_PX,
            height_px=SIZE_PX,
            bits_stored=16,
            case_id="case-1",
            case_revision=1,
            nominal_source_to_detector_mm=1000.0,
            nominal_pixel_mm=0.235,
            positioner_primary_angle_deg=85.0,
            positioner_secondary_angle_deg=3.0,
            run_interval_s=RUN_INTERVAL_S if in_run else None,
            age_s=0.0,
        )
        message = CalibrationMessage(
            image=header.reference(),
            case_id="case-1",
            case_revision=1,
            ring_sha256=part_sha256(RING_JSON.encode(), "ring"),
            software_version="0",
            verdict="rejected" if calibration is None else "accepted",
            reasons=() if calibration else (ReasonMessage(code=ReasonCode.RING_NOT_FOUND, message="no ring; show it"),),
            values=None if calibration is None else CalibrationValues.of(calibration),
            elapsed_ms=10.0,
        )
        self.bus.publisher(KEYS.frame).put(np.ascontiguousarray(pixels, dtype="<f4").tobytes(), encode(header))
        self.bus.retained_publisher(KEYS.calibration).put(encode(message))
        return self.sequence

    def robot_rests_at(self, x_mm: float | None) -> None:
        """The robot is heard of, and stands somewhere; None while its controller has not answered."""
        answers = x_mm is not None
        state = RobotState(
            boot_epoch="robot-1",
            sequence=1,
            sent_at_ns=0,
            state=MotionState.LOCKED,
            stop=StopLatch.CLEAR,
            locked=answers,
            referenced=answers,
            pose=PlatformPoseMessage(x_mm=x_mm, y_mm=0.0, z_mm=0.0, u_deg=0.0, v_deg=0.0, w_deg=0.0)
            if answers
            else None,
            leg_lengths_mm=None,
            pivot_mm=(0.0, 0.0, 0.0),
            hexapod_sha256=sha256_of(HEXAPOD_JSON.encode()),
        )
        self.bus.retained_publisher(KEYS.robot_state).put(encode(state))
        eventually(lambda: self.state.robot == state)

    def next_word(self) -> Guidance:
        return self.words.get(timeout=PATIENCE_S)


@pytest.fixture
def c_arm() -> Iterator[CArm]:
    router = MemoryRouter()
    settings = RegistrationSettings(live_check_every_s=600.0, image_delay_s=0.0)
    state = RegistrationState("registration-1", settings.kept_images, settings.image_delay_s, lambda: 100.0)
    with router.open() as bus:
        seen = CArm(bus, queue.Queue(), queue.Queue(), state)
        bus.subscribe(KEYS.guidance, lambda s: seen.words.put(decode(Guidance, s.payload)))
        bus.subscribe(KEYS.localisation, lambda s: seen.records.put(decode(LocalisationRecord, s.payload)))
        bus.retained_publisher(KEYS.case_context).put(encode(context()))
        with (
            open_service("registration", settings, lambda _: router.open()) as (own, runtime),
            RegistrationService(own, runtime, settings, state).running(),
        ):
            yield seen
            runtime.stop.set()


def test_a_shot_is_localised_and_the_frames_after_it_are_followed(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    shot = c_arm.shows(pixels, calibration, in_run=False)
    word = c_arm.next_word()
    assert (word.image.sequence, word.origin, word.verdict) == (shot, "localised", "accepted")
    assert c_arm.records.get(timeout=PATIENCE_S).image.sequence == shot

    for number in range(3):
        frame = c_arm.shows(pixels, calibration, in_run=True)
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
    c_arm.shows(pixels, calibration, in_run=False)
    assert c_arm.next_word().verdict == "accepted"
    frame = c_arm.shows(BLANK, None, in_run=True)
    word = c_arm.next_word()
    assert (word.image.sequence, word.verdict) == (frame, "rejected")
    assert [reason.code for reason in word.reasons] == [ReasonCode.RING_NOT_FOUND]
    assert (word.holes, word.c_arm_correction_deg, word.standard_uncertainty_deg) == (None, None, None)


def test_a_run_without_a_key_says_that_it_waits(c_arm: CArm) -> None:
    c_arm.shows(BLANK, None, in_run=False)
    assert c_arm.records.get(timeout=PATIENCE_S).localisation.verdict == "rejected"
    _, calibration = still_picture()
    frame = c_arm.shows(BLANK, calibration, in_run=True)
    word = c_arm.next_word()
    assert (word.image.sequence, word.verdict) == (frame, "rejected")
    assert word.reasons[0].code is ReasonCode.NAIL_NOT_FOUND
    assert "hold the C-arm still" in word.reasons[0].message


def test_a_controller_that_is_slow_to_answer_costs_no_track(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    c_arm.robot_rests_at(x_mm=0.0)
    c_arm.shows(pixels, calibration, in_run=False)
    assert c_arm.next_word().verdict == "accepted"
    c_arm.robot_rests_at(x_mm=None)
    c_arm.shows(pixels, calibration, in_run=True)
    with pytest.raises(queue.Empty):
        c_arm.words.get(timeout=2.0)
    c_arm.robot_rests_at(x_mm=0.0)
    frame = c_arm.shows(pixels, calibration, in_run=True)
    word = c_arm.next_word()
    assert (word.image.sequence, word.verdict, word.origin) == (frame, "accepted", "followed"), word.reasons
    assert word.skipped == 1


def test_a_key_is_worth_nothing_once_the_robot_has_moved(c_arm: CArm) -> None:
    pixels, calibration = still_picture()
    c_arm.shows(pixels, calibration, in_run=False)
    assert c_arm.next_word().verdict == "accepted"
    c_arm.robot_rests_at(x_mm=0.3)
    c_arm.shows(pixels, calibration, in_run=True)
    word = c_arm.next_word()
    assert (word.verdict, word.origin) == ("rejected", "followed")
    assert word.reasons[0].code is ReasonCode.NAIL_NOT_FOUND
    assert "hold the C-arm still" in word.reasons[0].message
