"""What a plan rests on: one image, several of one set-up, or a verification; and what it refuses to rest on."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.fusion import ImageResult
from services.registration.core.localise import Parts
from services.registration.core.wires.verify import AxisComparison, WireVerification
from services.registration.frames import LocalisedFrame, OpenCase, ReceivedFrame
from services.registration.planning import PlanAxes, axes_for
from services.registration.report import localisation_message
from services.registration.state import RegistrationState
from shared.errors import Reason, ReasonCode
from shared.geometry.lines import Line
from shared.messages.cases import CaseContext
from shared.messages.registration import LocalisationRecord, PlanReply, PlanRequest, Timing
from shared.messages.robot import PlatformPoseMessage
from shared.parts.files import sha256_of
from shared.parts.hexapod_file import hexapod_from_json
from tests.unit.services.registration.core.test_fusion import AMBIGUOUS, PARTS, UNCERTAIN, localised
from tests.unit.services.registration.outside import HOME, header, reference
from tests.unit.services.registration.rendered_case import GUIDE_JSON, HEXAPOD_JSON, NAIL_JSON, RING_JSON

TIMES = Timing(total=1.0, ring=1.0, guide=1.0, nail=1.0)


def case_of(parts: Parts) -> OpenCase:
    context = CaseContext(
        case_id="case-1",
        revision=1,
        ring_json=RING_JSON,
        guide_json=GUIDE_JSON,
        nail_json=NAIL_JSON,
        hexapod_json=HEXAPOD_JSON,
    )
    return OpenCase(context, parts, hexapod_from_json(HEXAPOD_JSON.encode()))


def frame(
    image: ImageResult, robot_pose: PlatformPoseMessage | None = HOME, revision: int = 1, boot: str = "robot-1"
) -> LocalisedFrame:
    """An image as registration remembers it."""
    record = LocalisationRecord(
        localisation=localisation_message(image.result, image.calibration, sha256_of(image.name.encode()), TIMES),
        image=reference(image.name),
        case_id="case-1",
        case_revision=revision,
        registration_epoch="registration-1.1",
        robot_boot_epoch=boot,
        robot_pose=robot_pose,
        ring_sha256="a" * 64,
        guide_sha256="b" * 64,
        nail_sha256="c" * 64,
        software_version="0",
    )
    received = ReceivedFrame(header(image.name), image.pixels, "registration-1.1", None)
    return LocalisedFrame(received, case_of(PARTS), record, replace(image, name=record.image.sha256[:12]))


def asked(newest: LocalisedFrame, *earlier: LocalisedFrame, knows: tuple[LocalisedFrame, ...] | None = None) -> object:
    state = RegistrationState("registration-1", 10, 0.5, lambda: 0.0)
    for one in (*earlier, newest) if knows is None else knows:
        state.images.note(one)
    request = PlanRequest(
        case_id="case-1",
        image_sha256=newest.record.image.sha256,
        hole_ids=("distal",),
        earlier_image_sha256=tuple(one.record.image.sha256 for one in earlier),
    )
    return axes_for(request, newest, state)


def refusal(answer: object) -> PlanReply:
    assert isinstance(answer, PlanReply)
    assert answer.verdict == "rejected"
    return answer


def planned(answer: object) -> PlanAxes:
    assert isinstance(answer, PlanAxes), answer
    return answer


def test_one_image_is_planned_from_as_it_is() -> None:
    newest = frame(localised("a"))
    axes = planned(asked(newest))
    assert axes.holes is newest.image.result.holes
    assert axes.fusion is None


def test_several_images_of_one_set_up_are_fused() -> None:
    axes = planned(asked(frame(localised("b", 0.04)), frame(localised("a"))))
    assert axes.fusion is not None
    assert [image.used for image in axes.fusion.images] == [True, True]
    assert axes.fusion.images[1].sha256 == sha256_of(b"b")
    alone = [localised(name, moved).result for name, moved in (("a", 0.0), ("b", 0.04))]
    places = [result.holes[0].entry_guide_mm for result in alone if result is not None and result.holes is not None]
    assert axes.holes[0].entry_guide_mm == pytest.approx(np.mean(places, axis=0), abs=2e-3)
    offsets = (axes.holes[0].offset, alone[0].holes[0].offset if alone[0] is not None and alone[0].holes else None)
    assert offsets[0] is not None
    assert offsets[1] is not None
    assert offsets[0].entry_sd_mm < offsets[1].entry_sd_mm


def test_an_image_that_was_only_uncertain_counts_with_others() -> None:
    newest = frame(localised("b", 0.0, 1.0, UNCERTAIN))
    assert refusal(asked(newest)).code == "not_accepted"
    planned(asked(newest, frame(localised("a"))))


@pytest.mark.requirement("REG-07")
def test_images_that_contradict_one_another_are_refused_with_the_reason() -> None:
    reply = refusal(asked(frame(localised("b", 2.0)), frame(localised("a"))))
    assert reply.code == "not_accepted"
    assert "see the nail in different places from the guide" in reply.message


def test_the_newest_image_must_be_usable_itself() -> None:
    reply = refusal(asked(frame(localised("b", 0.0, 1.0, AMBIGUOUS)), frame(localised("a"))))
    assert reply.code == "not_accepted"
    assert "the newest image cannot be fused" in reply.message


@pytest.mark.parametrize(
    ("earlier", "words"),
    [
        (frame(localised("a"), HOME.model_copy(update={"x_mm": 0.5})), "the robot was moved by 0.500 mm"),
        (frame(localised("a"), None), "where the robot stood is not known for both"),
        (frame(localised("a"), HOME, 1, "robot-0"), "where the robot stood is not known for both"),
        (frame(localised("a"), HOME, 2), "under revision 2"),
    ],
    ids=["robot moved", "robot unknown", "robot restarted", "another revision"],
)
def test_images_of_another_set_up_are_refused(earlier: LocalisedFrame, words: str) -> None:
    reply = refusal(asked(frame(localised("b")), earlier))
    assert reply.code == "another_set_up"
    assert words in reply.message


def test_an_image_that_is_not_remembered_is_refused() -> None:
    newest = frame(localised("b"))
    assert refusal(asked(newest, frame(localised("a")), knows=(newest,))).code == "unknown_image"


def test_an_image_named_twice_is_refused() -> None:
    newest = frame(localised("b"))
    assert refusal(asked(newest, newest)).code == "image_twice"


def verified(*reasons: Reason, used: tuple[str, ...] = ("a", "oblique")) -> WireVerification:
    """A wire half a millimetre beside the distal hole of the guide; the hole where the wires put it, 0.2 mm off."""
    result = localised("a").result
    assert result is not None
    assert result.holes is not None
    found = result.holes[0]
    hole = replace(found, entry_guide_mm=found.entry_guide_mm + np.array([0.0, 0.2, 0.0]))
    guide_hole = next(one for one in PARTS.guide.holes if one.id == hole.id)
    axis = Line(guide_hole.axis.point_mm + np.array([0.5, 0.0, 0.0]), guide_hole.axis.direction)
    wire = AxisComparison(hole, axis, AxisOffset(np.full(4, 0.3), np.eye(4) * 0.01, 12.0))
    return WireVerification(reasons, (wire,), (), tuple(sha256_of(name.encode())[:12] for name in used))


def asked_after(
    verification: WireVerification, *names: str, newest: str = "a", kept: tuple[str, ...] = ("a", "oblique")
) -> object:
    state = RegistrationState("registration-1", 10, 0.5, lambda: 0.0)
    for name in kept:
        state.images.note(frame(localised(name)))
    state.note_verified((sha256_of(b"a"), sha256_of(b"oblique")), verification)
    request = PlanRequest(
        case_id="case-1",
        image_sha256=sha256_of(newest.encode()),
        hole_ids=("distal",),
        verified_image_sha256=tuple(sha256_of(name.encode()) for name in names),
    )
    return axes_for(request, frame(localised(newest)), state)


def test_a_verification_whose_images_are_not_kept_is_asked_for_again() -> None:
    answer = refusal(asked_after(verified(), "a", "oblique", kept=("a",)))
    assert answer.code == "unknown_verification"
    assert answer.message == "these images were not verified last, or are not kept any more; verify them again"


def test_a_verification_brings_the_wires_onto_the_holes() -> None:
    axes = planned(asked_after(verified(), "a", "oblique"))
    (hole,) = axes.guide.holes
    nominal = next(one for one in PARTS.guide.holes if one.id == hole.id)
    assert hole.axis.point_mm - nominal.axis.point_mm == pytest.approx([0.5, 0.0, 0.0])
    assert axes.holes[0].entry_guide_mm == pytest.approx(verified().wires[0].hole.entry_guide_mm)
    offset = axes.holes[0].offset
    assert offset is not None
    assert offset.entry_mm == 0.0
    assert offset.entry_sd_mm == pytest.approx(0.1 * np.sqrt(2.0))


def test_the_newest_image_must_have_added_to_the_verification() -> None:
    reply = refusal(asked_after(verified(used=("oblique",)), "a", "oblique"))
    assert reply.code == "not_accepted"
    assert "added nothing to the verification" in reply.message


def test_a_rejected_verification_moves_nothing() -> None:
    lost = Reason(ReasonCode.WIRE_NOT_FOUND, "no wire was found; insert it")
    reply = refusal(asked_after(verified(lost), "a", "oblique"))
    assert (reply.code, "no wire was found" in reply.message) == ("not_accepted", True)


def test_only_the_last_verification_counts_and_only_with_the_newest_image() -> None:
    assert refusal(asked_after(verified(), "a")).code == "unknown_verification"
    assert refusal(asked_after(verified(), "a", "oblique", newest="b")).code == "stale"
