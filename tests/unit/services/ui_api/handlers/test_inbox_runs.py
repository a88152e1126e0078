"""A running fluoroscopy on its way into the record: every frame is named there, few calibrations are kept."""

from pathlib import Path

from services.ui_api.core.case import Case
from services.ui_api.record.database import existing_database, sqlite_url
from services.ui_api.record.tables import DOCUMENTS
from shared.messages.base import encode
from shared.messages.imaging import CalibrationMessage, FrameHeader
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, open_room

NEWEST, FRAMES = 3, 20
LONGER_THAN_ANY_TEST_S = 30.0


def frame(room: Room, case_id: str, number: int, run_interval_s: float | None) -> FrameHeader:
    """A frame arrives and is calibrated."""
    header = arriving(room, case_id, number, run_interval_s)
    calibrate(room, header)
    return header


def arriving(room: Room, case_id: str, number: int, run_interval_s: float | None) -> FrameHeader:
    """A frame arrives; it is not calibrated yet."""
    header = samples.frame_header(f"frame {number}", case_id, 1, number + 1)
    header = header.model_copy(update={"run_interval_s": run_interval_s, "store_id": room.imaging.store_id})
    room.imaging.keep(header)
    room.imaging.bus.publisher(room.imaging.keys.frame).put(samples.pixels(), encode(header))
    return header


def run_of_frames(room: Room, case_id: str, run_interval_s: float = LONGER_THAN_ANY_TEST_S) -> list[FrameHeader]:
    """Frames of a run as imaging marks them: the first one follows no other."""
    return [frame(room, case_id, number, run_interval_s if number else None) for number in range(FRAMES)]


def calibrate(room: Room, header: FrameHeader) -> None:
    """Its calibration arrives (here: rejected, which is as much a calibration)."""
    message = CalibrationMessage(
        image=header.reference(),
        case_id=header.case_id,
        case_revision=1,
        ring_sha256=samples.sha("ring"),
        software_version="0.1.0",
        verdict="rejected",
        reasons=(),
        values=None,
        elapsed_ms=1.0,
    )
    room.imaging.bus.retained_publisher(room.imaging.keys.calibration).put(encode(message))


def calibrated(room: Room, case_id: str) -> list[str]:
    return [one.image_sha256 for one in case_of(room, case_id).calibrations]


def case_of(room: Room, case_id: str) -> Case:
    return room.gateway.record.ledger.cases[case_id]


def test_of_a_run_the_newest_and_the_localised_frames_are_recorded_whole(tmp_path: Path) -> None:
    with open_room(tmp_path, run_calibrations=NEWEST) as room:
        case_id = room.open_case()
        run = run_of_frames(room, case_id)
        # nothing orders messages of different keys: a localisation may overtake frames that came long before it
        room.log.wait_for(lambda: len(case_of(room, case_id).images) == FRAMES)
        room.registration.publish(run[5])
        # the localisation and the calibration that goes with it are recorded one after the other
        room.log.wait_for(
            lambda: len(case_of(room, case_id).localisations) == 1 and len(calibrated(room, case_id)) == 2
        )
        assert calibrated(room, case_id) == [run[0].sha256, run[5].sha256]
        # a single shot: the run has ended
        shot = frame(room, case_id, FRAMES, None)
        kept = [run[0], run[5], *run[-NEWEST:], shot]
        room.log.wait_for(lambda: len(calibrated(room, case_id)) == len(kept))
        assert calibrated(room, case_id) == [one.sha256 for one in kept]
        assert [image.image_sha256 for image in case_of(room, case_id).images] == [h.sha256 for h in (*run, shot)]
    with existing_database(sqlite_url(tmp_path)).connect() as connection:
        documents = [row.content for row in connection.execute(DOCUMENTS.select())]
    assert sum(b"distalock/calibration/" in content for content in documents) == len(kept)


def test_a_frame_whose_localisation_comes_after_the_run_has_ended_is_recorded_whole(tmp_path: Path) -> None:
    with open_room(tmp_path, run_calibrations=NEWEST) as room:
        case_id = room.open_case()
        run = run_of_frames(room, case_id)
        shot = frame(room, case_id, FRAMES, None)
        kept = [run[0], *run[-NEWEST:], shot]
        room.log.wait_for(lambda: len(calibrated(room, case_id)) == len(kept))
        room.registration.publish(run[5])
        room.log.wait_for(lambda: len(case_of(room, case_id).localisations) == 1)
        assert calibrated(room, case_id) == [one.sha256 for one in (*kept, run[5])]


def test_a_localisation_that_overtakes_its_frames_calibration_loses_nothing(tmp_path: Path) -> None:
    with open_room(tmp_path, run_calibrations=NEWEST) as room:
        case_id = room.open_case()
        run = run_of_frames(room, case_id)
        next_one = arriving(room, case_id, FRAMES, LONGER_THAN_ANY_TEST_S)
        room.registration.publish(next_one)
        room.log.wait_for(lambda: len(case_of(room, case_id).localisations) == 1)
        calibrate(room, next_one)
        room.log.wait_for(lambda: len(calibrated(room, case_id)) == 2)
        assert calibrated(room, case_id) == [run[0].sha256, next_one.sha256]


def test_a_run_has_ended_when_no_frame_follows(tmp_path: Path) -> None:
    with open_room(tmp_path, run_calibrations=NEWEST) as room:
        case_id = room.open_case()
        run = run_of_frames(room, case_id, run_interval_s=0.3)
        room.log.wait_for(lambda: len(calibrated(room, case_id)) > NEWEST)
        assert calibrated(room, case_id)[-1] == run[-1].sha256


def test_a_run_that_the_gateways_end_cuts_off_is_recorded(tmp_path: Path) -> None:
    with open_room(tmp_path, run_calibrations=NEWEST) as room:
        case_id = room.open_case()
        run = run_of_frames(room, case_id)
        room.log.wait_for(lambda: len(case_of(room, case_id).images) == FRAMES)
    with open_room(tmp_path) as again:
        assert calibrated(again, case_id) == [one.sha256 for one in (run[0], *run[-NEWEST:])]
