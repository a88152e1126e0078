"""Guidance alone: words in the order of arrival, contradictions told, set-ups that were left behind."""

import queue
from collections.abc import Iterator
from dataclasses import dataclass, replace

import pytest

from services.registration.core.fusion import ImageResult
from services.registration.core.localise import LocalisationResult
from services.registration.frames import LocalisedFrame, OpenCase, ReceivedFrame
from services.registration.live import LiveGuidance
from services.registration.report import localisation_message
from services.registration.settings import RegistrationSettings
from services.registration.state import RegistrationState
from shared.bus.memory_bus import MemoryRouter
from shared.errors import Reason, ReasonCode
from shared.messages.base import decode
from shared.messages.guidance import Guidance
from shared.messages.imaging import CalibrationMessage, CalibrationValues
from shared.messages.registration import LocalisationRecord
from shared.parts.canonical import part_sha256
from shared.parts.files import sha256_of
from shared.runtime.lifecycle import open_service
from tests.unit.services.registration.live_case import context, found_in_full, still_picture
from tests.unit.services.registration.outside import KEYS, PATIENCE_S, header, reference
from tests.unit.services.registration.rendered_case import (
    RING_JSON,
    turned_nail,
)
from tests.unit.services.registration.test_planning import TIMES


@dataclass
class Lone:
    """Guidance alone, handed images and what a full localisation found in them."""

    guidance: LiveGuidance
    state: RegistrationState
    words: "queue.Queue[Guidance]"

    def arrives(self, name: str, at_s: float, revision: int = 1, *, in_run: bool) -> None:
        """An image with its pixels and its calibration."""
        pixels, calibration = still_picture()
        head = header(name).model_copy(update={"received_at_ns": int(1e9 * at_s), "case_revision": revision})
        self.state.note_frame(head, pixels)
        self.guidance.takes(
            CalibrationMessage(
                image=reference(name).model_copy(
                    update={"received_at_ns": int(1e9 * at_s), "run_interval_s": 0.5 if in_run else None}
                ),
                case_id="case-1",
                case_revision=revision,
                ring_sha256=part_sha256(RING_JSON.encode(), "ring"),
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
        image = ImageResult(record.image.sha256[:12], pixels, calibration, found)
        self.guidance.note_localised(LocalisedFrame(frame, case, record, image))

    def next_word(self) -> Guidance:
        return self.words.get(timeout=PATIENCE_S)


@pytest.fixture
def lone() -> Iterator[Lone]:
    router, settings = MemoryRouter(), RegistrationSettings(live_check_every_s=600.0)
    state = RegistrationState("registration-1", settings.kept_images, settings.image_delay_s, lambda: 100.0)
    state.open_case(OpenCase.of(context()))
    words: queue.Queue[Guidance] = queue.Queue()
    with router.open() as bus, open_service("registration", settings, lambda _: router.open()) as (own, runtime):
        bus.subscribe(KEYS.guidance, lambda s: words.put(decode(Guidance, s.payload)))
        guidance = LiveGuidance(own, runtime, settings, state)
        with guidance.running():
            yield Lone(guidance, state, words)
            runtime.stop.set()


def followed_after_a_shot(lone: Lone) -> Guidance:
    """The word of frame `b`, which came after the shot `a`."""
    lone.arrives("a", 10.0, in_run=False)
    lone.localised("a", found_in_full())
    assert lone.next_word().origin == "localised"
    lone.arrives("b", 10.1, in_run=True)
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
    lone.arrives("c", 10.2, in_run=True)
    assert "hold the C-arm still" in lone.next_word().reasons[0].message


def test_a_localisation_of_a_set_up_that_was_left_begins_nothing(lone: Lone) -> None:
    lone.arrives("a", 10.0, in_run=False)
    lone.state.open_case(OpenCase.of(context(revision=2)))
    lone.localised("a", found_in_full())
    lone.arrives("b", 10.1, revision=2, in_run=True)
    word = lone.next_word()
    assert (word.image.sha256, word.case_revision, word.verdict) == (sha256_of(b"b"), 2, "rejected")
    assert "hold the C-arm still" in word.reasons[0].message


def test_a_localisation_that_took_long_is_not_told_after_a_newer_frame(lone: Lone) -> None:
    """Even when the wall clock was set back between the two images."""
    followed_after_a_shot(lone)
    lone.arrives("old", 10.15, in_run=True)
    assert lone.next_word().image.sha256 == sha256_of(b"old")
    lone.arrives("set back", 3.0, in_run=False)
    assert lone.next_word().image.sha256 == sha256_of(b"set back")
    found = found_in_full()
    assert found.nail is not None
    lone.localised("old", replace(found, nail=replace(found.nail, camera_from_nail=turned_nail((6.0, 0.0)))))
    lone.arrives("last", 3.1, in_run=True)
    assert lone.next_word().image.sha256 == sha256_of(b"last")
