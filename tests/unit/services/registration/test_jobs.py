"""The newest image is localised next, and whoever asks for another one gets it or a reason."""

from dataclasses import dataclass, field

import pytest

from services.registration.frames import OpenCase
from services.registration.jobs import LocalisationJobs
from services.registration.state import RegistrationState
from shared.messages.imaging import CalibrationMessage, ImageReference
from shared.messages.stored_images import LocalisationReply, LocalisationRequest, SkipCode
from shared.parts.files import sha256_of
from tests.unit.services.registration.core.test_fusion import localised
from tests.unit.services.registration.live_case import context
from tests.unit.services.registration.test_planning import frame


def image(number: int, store_id: str = "store-1") -> ImageReference:
    return ImageReference(
        sha256=sha256_of(b"%d" % number), sop_instance_uid="1.2", sequence=number, received_at_ns=0, store_id=store_id
    )


def calibration(number: int) -> CalibrationMessage:
    return CalibrationMessage(
        image=image(number),
        case_id="case-1",
        case_revision=1,
        ring_sha256=None,
        software_version="0",
        verdict="rejected",
        reasons=(),
        values=None,
        elapsed_ms=1.0,
    )


@dataclass
class Rig:
    """Registration's jobs, and who asks."""

    state: RegistrationState = field(default_factory=lambda: RegistrationState("registration-1", 4, 0.5, lambda: 100.0))

    def __post_init__(self) -> None:
        self.jobs = LocalisationJobs(self.state)
        self.state.open_case(OpenCase.of(context()))

    def ask(self, number: int, newest: int, revision: int = 1, open_revision: int = 1) -> LocalisationReply:
        request = LocalisationRequest(
            calibration=calibration(number).model_copy(update={"case_revision": revision}),
            newest=image(newest),
            open_case_id="case-1",
            open_case_revision=open_revision,
        )
        return self.jobs.reply(request)

    def why(self, reply: LocalisationReply) -> SkipCode | None:
        return None if reply.skip is None else reply.skip.code


def test_the_newest_of_those_that_wait_is_localised_and_the_others_are_named() -> None:
    rig = Rig()
    assert [rig.jobs.put(calibration(number)) for number in (1, 2, 3)] == [None, image(1).sha256, image(2).sha256]
    assert rig.jobs.put(calibration(2)) == image(2).sha256, "an older one does not push out a newer one"
    assert rig.jobs.put(calibration(3)) is None
    taken = rig.jobs.take(0.0)
    assert taken is not None
    assert taken.image.sequence == 3
    assert rig.jobs.take(0.0) is None


def test_an_image_that_was_missed_is_localised_once() -> None:
    rig = Rig()
    assert rig.ask(1, newest=1) == LocalisationReply()
    assert rig.ask(1, newest=1) == LocalisationReply(), "it waits"
    taken = rig.jobs.take(0.0)
    assert taken is not None
    assert rig.ask(1, newest=1) == LocalisationReply(), "it is in work"
    assert rig.jobs.take(0.0) is None, "once"


def test_an_image_that_was_localised_is_handed_out() -> None:
    rig = Rig()
    known = frame(localised("a"))
    rig.state.images.note(known)
    asked = calibration(1).model_copy(update={"image": known.record.image})
    request = LocalisationRequest(calibration=asked, newest=known.record.image)
    assert rig.jobs.reply(request).record == known.record


def test_an_image_that_a_newer_one_has_overtaken_is_superseded_also_after_a_restart() -> None:
    rig = Rig()
    assert rig.why(rig.ask(1, newest=2)) is SkipCode.SUPERSEDED
    assert rig.state.newest == image(2), "nothing is planned from an older one"
    assert rig.jobs.take(0.0) is None


def test_an_image_that_is_in_work_is_not_superseded() -> None:
    rig = Rig()
    rig.jobs.put(calibration(1))
    rig.jobs.take(0.0)
    assert rig.ask(1, newest=2) == LocalisationReply()


def test_an_image_of_another_set_up_is_not_localised_once_registration_knows_the_present_one() -> None:
    rig = Rig()
    assert rig.why(rig.ask(1, newest=1, revision=1, open_revision=2)) is SkipCode.SET_UP_CHANGED
    assert rig.ask(1, newest=1, revision=2, open_revision=2) == LocalisationReply()
    assert rig.jobs.take(0.0) is None, "the announcement of revision 2 is on its way"


def test_an_image_that_brought_a_fault_is_not_tried_for_ever() -> None:
    rig = Rig()
    rig.jobs.put(calibration(1))
    rig.jobs.take(0.0)
    rig.jobs.done("division by zero")
    reply = rig.ask(1, newest=1)
    assert rig.why(reply) is SkipCode.FAULT
    assert reply.skip is not None
    assert reply.skip.message == "it brought a fault (division by zero); take another image"


def test_a_case_that_cannot_be_used_is_said_so() -> None:
    rig = Rig()
    rig.jobs.unusable_case = "nail file: no holes"
    assert rig.why(rig.ask(1, newest=1)) is SkipCode.FAULT


@pytest.mark.parametrize(("other", "precedes"), [(image(2), True), (image(1), False), (image(2, "store-2"), False)])
def test_images_of_two_stores_have_no_order(other: ImageReference, *, precedes: bool) -> None:
    assert image(1).precedes(other) is precedes


def test_an_older_image_makes_nothing_stale() -> None:
    rig = Rig()
    rig.state.note_announced(image(2))
    epoch = rig.state.epoch
    rig.state.note_announced(image(1))
    assert (rig.state.epoch, rig.state.newest) == (epoch, image(2))
    rig.state.note_announced(image(3))
    assert rig.state.epoch != epoch
