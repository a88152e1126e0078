"""Images: they join the open case by themselves, and are shown as received, corrected or with what was found."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.transform import Transform
from shared.messages.base import encode
from shared.messages.imaging import CalibrationMessage, CalibrationValues, FrameHeader
from shared.messages.registration import LocalisationRecord
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room

_SHIFT_PX = 2.0


def _calibration(*, mirrored: bool) -> CalibrationValues:
    """A C-arm whose image is shifted by two columns against the ideal one: ideal = measured + 2."""
    field = DisplacementField(np.zeros(2), 4.0, np.broadcast_to([_SHIFT_PX, 0.0], (4, 4, 2)).copy(), np.zeros((4, 4)))
    none = np.zeros(0)
    return CalibrationValues.of(
        CArmCalibration(
            width_px=samples.WIDTH_PX,
            height_px=samples.HEIGHT_PX,
            mirrored=mirrored,
            camera=PinholeCamera(np.array(samples.INTRINSIC)),
            camera_from_ring=Transform.from_matrix(np.eye(4)),
            distortion=field,
            source_covariance_mm2=np.eye(3),
            balls=BallCandidates(np.zeros((0, 2)), none, none, none, np.zeros(0, dtype=np.int64)),
            balls_expected=0,
            distortion_residual_px=0.0,
            reprojection_rms_px=0.0,
            runner_up_margin=1.0,
            aperture=None,
        )
    )


def _publish_calibration(room: Room, header: FrameHeader, values: CalibrationValues | None) -> None:
    message = CalibrationMessage(
        image=header.reference(),
        case_id=header.case_id,
        case_revision=header.case_revision,
        ring_sha256=samples.sha("ring"),
        software_version="0.1.0",
        verdict="rejected" if values is None else "accepted",
        reasons=(),
        values=values,
        elapsed_ms=1.0,
    )
    room.imaging.bus.retained_publisher(room.imaging.keys.calibration).put(b"", b"")  # not a message: only logged
    room.imaging.bus.retained_publisher(room.imaging.keys.calibration).put(encode(message))
    ledger = room.gateway.record.ledger
    room.log.wait_for(lambda: any(c.calibration_of(header.sha256) for c in ledger.cases.values()))


def _png(content: bytes) -> NDArray[np.uint8]:
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED), dtype=np.uint8)


def _arrive(room: Room, case_id: str, name: str = "image") -> FrameHeader:
    header = room.imaging.send(name, case_id)
    room.log.wait_for(lambda: room.gateway.record.ledger.cases[case_id].image(header.sha256) is not None)
    return header


def test_images_join_the_case_by_themselves(room: Room) -> None:
    case_id = room.open_case()
    header = _arrive(room, case_id)
    listed = room.get(f"/cases/{case_id}/images").json()["items"]
    assert [i["id"] for i in listed] == [header.sha256]
    assert listed[0]["header"]["model_name"] == "virtual C-arm (simulation)"
    assert listed[0]["localisation"] is None
    read = room.get(f"/images/{header.sha256}").json()
    assert read == listed[0] | {"age_s": read["age_s"]}
    assert read["age_s"] >= listed[0]["age_s"]


def test_an_image_dropped_on_the_bus_is_learnt_of_from_its_localisation(room: Room) -> None:
    case_id = room.open_case()
    header = room.imaging.store("dropped", case_id)
    record = room.registration.publish(header)
    ledger = room.gateway.record.ledger
    epoch = record.registration_epoch
    room.log.wait_for(lambda: ledger.cases[case_id].knows_localisation(header.sha256, epoch))
    image = room.get(f"/images/{header.sha256}").json()
    assert (image["localisation"], image["header"]["width_px"]) == (1, samples.WIDTH_PX)


def test_a_localisation_heard_twice_is_recorded_once(room: Room) -> None:
    case_id = room.open_case()
    header = _arrive(room, case_id)
    record: LocalisationRecord = room.registration.publish(header)
    room.registration.repeat(record)
    room.image("next", case_id)
    assert len(room.gateway.record.ledger.cases[case_id].localisations) == 2


def test_the_raw_view_is_the_image_as_received(room: Room) -> None:
    header = _arrive(room, room.open_case())
    answer = room.get(f"/images/{header.sha256}.png")
    assert answer.headers["content-type"] == "image/png"
    shown = _png(answer.content)
    assert shown.shape == (samples.HEIGHT_PX, samples.WIDTH_PX)
    assert (int(shown.min()), int(shown.max())) == (0, 255)
    assert np.all(np.diff(shown.ravel().astype(int)) >= 0)


def test_the_corrected_view_has_no_distortion_and_no_mirror(room: Room) -> None:
    case_id = room.open_case()
    views = {}
    for name, mirrored in (("straight", False), ("mirrored", True)):
        header = _arrive(room, case_id, name)
        _publish_calibration(room, header, _calibration(mirrored=mirrored))
        raw = _png(room.get(f"/images/{header.sha256}.png?view=raw").content)
        views[name] = raw, _png(room.get(f"/images/{header.sha256}.png?view=corrected").content)
    raw, corrected = views["straight"]
    shift = int(_SHIFT_PX)
    assert np.array_equal(corrected[:, shift:], raw[:, :-shift])
    raw, corrected = views["mirrored"]
    assert np.array_equal(corrected[:, shift:], raw[:, ::-1][:, :-shift])


def test_views_that_do_not_exist_say_why(room: Room) -> None:
    header = _arrive(room, room.open_case())
    for view, code in (("corrected", "image_not_calibrated"), ("overlay", "no_overlay")):
        answer = room.get(f"/images/{header.sha256}.png?view={view}")
        assert (answer.status_code, answer.json()["code"]) == (409, code)
    _publish_calibration(room, header, None)
    assert room.get(f"/images/{header.sha256}").json()["calibrated"] is False
    assert room.get(f"/images/{header.sha256}.png?view=corrected").json()["code"] == "image_not_calibrated"
    assert room.get(f"/images/{header.sha256}.png?view=upside-down").json()["code"] == "request_invalid"


def test_pixels_that_imaging_does_not_hand_out_are_unreachable(room: Room) -> None:
    header = _arrive(room, room.open_case())
    room.router.cut()
    answer = room.get(f"/images/{header.sha256}.png")
    assert (answer.status_code, answer.json()["code"]) == (503, "pixels_unreachable")


def test_the_dicom_file_is_handed_out_byte_for_byte(room: Room, tmp_path: Path) -> None:
    header = _arrive(room, room.open_case())
    missing = room.get(f"/images/{header.sha256}.dcm")
    assert (missing.status_code, missing.json()["code"]) == (503, "image_file_unreachable")
    folder = tmp_path / "images" / header.sha256[:2]
    folder.mkdir(parents=True)
    (folder / f"{header.sha256}.dcm").write_bytes(b"DICM")
    answer = room.get(f"/images/{header.sha256}.dcm")
    assert (answer.headers["content-type"], answer.content) == ("application/dicom", b"DICM")


def test_an_unknown_image_is_not_found(room: Room) -> None:
    for suffix in ("", ".dcm", ".png"):
        answer = room.get(f"/images/{samples.sha('unknown')}{suffix}")
        assert (answer.status_code, answer.json()["code"]) == (404, "image_not_found")
    assert room.get("/images/short").json()["code"] == "request_invalid"


def test_the_newest_image_tells_whether_the_c_arm_is_simulated(room: Room) -> None:
    assert room.get("/robot").json()["image_source_simulated"] is None
    _arrive(room, room.open_case())
    robot = room.get("/robot").json()
    assert (robot["image_source_simulated"], robot["simulated"], robot["validity"]) == (True, True, "current")
