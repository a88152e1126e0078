"""What the gateway missed is asked for until it is on record: images, calibrations, localisations, or why not."""

from collections.abc import Callable
from pathlib import Path

from services.ui_api.core.case import Case
from services.ui_api.core.image_numbers import NumbersOnRecord
from shared.messages.stored_images import LocalisationReply, Skip, SkipCode, Step
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, open_room

SUPERSEDED = Skip(step=Step.LOCALISATION, code=SkipCode.SUPERSEDED, message="a newer image has come")


def case_of(room: Room, case_id: str) -> Case:
    return room.gateway.record.ledger.cases[case_id]


def numbers(room: Room, case_id: str) -> list[int | None]:
    return [image.sequence for image in case_of(room, case_id).images]


def wait_for(room: Room, holds: Callable[[], bool]) -> None:
    room.log.wait_for(holds)


def test_images_that_nobody_published_are_recorded_in_their_order(room: Room) -> None:
    case_id = room.open_case()
    for name in ("one", "two", "three"):
        room.imaging.store(name, case_id)
    newest = room.imaging.send("four", case_id)
    wait_for(room, lambda: numbers(room, case_id) == [1, 2, 3, 4])
    assert case_of(room, case_id).images[-1].image_sha256 == newest.sha256
    listed = room.get(f"/cases/{case_id}/images").json()["items"]
    assert [one["header"]["sequence"] for one in listed] == [1, 2, 3, 4]


def test_images_from_while_the_gateway_was_down_are_recorded_when_it_is_back(tmp_path: Path) -> None:
    with open_room(tmp_path) as before:
        case_id = before.open_case()
        before.image("one", case_id)
        store_id, stored = before.imaging.store_id, before.imaging.stored
    with open_room(tmp_path) as after:
        after.imaging.store_id, after.imaging.stored = store_id, list(stored)
        for name in ("two", "three"):
            after.imaging.store(name, case_id)
        wait_for(after, lambda: numbers(after, case_id) == [1, 2, 3])


def test_more_images_than_one_answer_holds_are_recorded_too(room: Room) -> None:
    case_id = room.open_case()
    for number in range(100):
        room.imaging.store(f"image {number}", case_id if number % 2 else None)
    room.imaging.send("last", case_id)
    wait_for(room, lambda: room.gateway.record.ledger.images.get(room.imaging.store_id) == NumbersOnRecord(101))


def test_a_missed_calibration_is_fetched_and_then_registration_is_asked(room: Room) -> None:
    case_id = room.open_case()
    header = room.imaging.store("one", case_id, calibration="done")
    wait_for(room, lambda: case_of(room, case_id).calibration_of(header.sha256) is not None)
    record = samples.localisation_record(header, "registration-1.7")
    room.registration.replies[header.sha256] = LocalisationReply(record=record)
    wait_for(room, lambda: case_of(room, case_id).localisation_of(header.sha256) is not None)
    assert room.get(f"/images/{header.sha256}").json()["localisation"] == 1


def test_why_an_image_is_not_localised_is_on_record_and_asked_once(room: Room) -> None:
    case_id = room.open_case()
    old = room.imaging.store("old", case_id, calibration="done")
    new = room.imaging.store("new", case_id, calibration="done")
    room.registration.replies[old.sha256] = LocalisationReply(skip=SUPERSEDED)
    room.registration.replies[new.sha256] = LocalisationReply(
        record=samples.localisation_record(new, "registration-1.1")
    )
    wait_for(room, lambda: case_of(room, case_id).skip_of(old.sha256) is not None)
    wait_for(room, lambda: case_of(room, case_id).localisation_of(new.sha256) is not None)
    view = room.get(f"/images/{old.sha256}").json()
    assert view["skipped"] == {"step": "localisation", "code": "superseded", "message": "a newer image has come"}
    asked = room.registration.localisation_requests
    assert {one.newest.sha256 for one in asked if one.calibration.image.sha256 == new.sha256} == {new.sha256}
    assert len(case_of(room, case_id).skipped) == 1


def test_why_an_image_is_not_calibrated_is_on_record(room: Room) -> None:
    case_id = room.open_case()
    header = room.imaging.send("one", case_id)
    skip = Skip(step=Step.CALIBRATION, code=SkipCode.SET_UP_CHANGED, message="it was taken in another set-up")
    room.imaging.keep(header, "skipped", skip)
    wait_for(room, lambda: case_of(room, case_id).skip_of(header.sha256) is not None)
    assert room.get(f"/images/{header.sha256}").json()["skipped"]["code"] == "set_up_changed"


def test_an_image_store_that_was_replaced_is_said_so(room: Room) -> None:
    case_id = room.open_case()
    header = room.imaging.send("one", case_id)
    wait_for(room, lambda: numbers(room, case_id) == [1])
    room.imaging.store_id, room.imaging.stored = "another-store", []
    wait_for(room, lambda: case_of(room, case_id).skip_of(header.sha256) is not None)
    assert case_of(room, case_id).skipped[0].code == "another_store"


def test_while_imaging_does_not_answer_nothing_is_said_of_its_store(room: Room) -> None:
    room.imaging.silent = True
    case_id = room.open_case()
    header = room.imaging.send("one", case_id)
    wait_for(room, lambda: numbers(room, case_id) == [1])
    for _ in range(2):  # a whole round lies between two questions for images
        room.imaging.asked_in_vain.clear()
        assert room.imaging.asked_in_vain.wait(PATIENCE_S)
    assert case_of(room, case_id).skipped == ()
    room.imaging.silent = False
    room.imaging.keep(header, "done")
    wait_for(room, lambda: case_of(room, case_id).calibration_of(header.sha256) is not None)


def test_a_late_older_image_makes_nothing_stale(room: Room) -> None:
    case_id = room.open_case()
    missed = samples.frame_header("missed", case_id, 1, 1).model_copy(update={"store_id": room.imaging.store_id})
    room.imaging.keep(missed)
    room.image("newest", case_id)
    wait_for(room, lambda: numbers(room, case_id) == [1, 2])
    answer = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["proximal", "distal"]})
    assert answer.status_code == 201, answer.text


def test_a_localisation_that_comes_late_is_not_the_newest(room: Room) -> None:
    case_id = room.open_case()
    old = room.imaging.store("old", case_id, calibration="done")
    new = room.image("new", case_id)
    record = samples.localisation_record(old, "registration-1.0")
    room.registration.replies[old.sha256] = LocalisationReply(record=record)
    wait_for(room, lambda: case_of(room, case_id).localisation_of(old.sha256) is not None)
    views = room.get(f"/cases/{case_id}/localisations").json()["items"]
    assert [(one["image"]["sha256"], one["validity"]) for one in views] == [
        (new.sha256, "current"),
        (old.sha256, "stale"),
    ]
    assert room.get(f"/cases/{case_id}/alignment").json()["localisation"] == 1
    body = {"localisation": 1, "hole_ids": ["proximal", "distal"]}
    assert room.post(f"/cases/{case_id}/plans", body).status_code == 201
