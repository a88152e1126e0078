"""A case with what `distalock robot calibrate-guide` printed: the hexapod's head is then as found."""

import json

import numpy as np
import pytest

from services.ui_api.core.event_data import SetupChanged
from shared.geometry.frames import Guide
from shared.geometry.transform import Transform
from shared.parts.files import read_part_file
from shared.parts.guide_calibration_file import GuideCalibrationFile
from shared.parts.hexapod_file import DEFAULT_HEXAPOD, default_hexapod, hexapod_from_json, hexapod_json_with_head
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room

OFF: Transform[Guide, Guide] = Transform.from_rotvec([0.01, -0.004, 0.02], [0.4, -0.3, 0.6])
FOUND = default_hexapod().top_from_guide(62.0) @ OFF


def printed(**changes: object) -> dict[str, object]:
    """What the command prints."""
    file = GuideCalibrationFile.model_validate(
        {
            "schema": "distalock/guide-calibration/1",
            "verdict": "accepted",
            "reasons": [],
            "hexapod_sha256": default_hexapod().sha256,
            "guide_sha256": "a" * 64,
            "head_extension_mm": 62.0,
            "top_from_guide": FOUND.matrix.tolist(),
            "standard_uncertainty": {"translation_mm": 0.04, "rotation_deg": 0.03},
            "covariance": np.eye(6).tolist(),
            "normalised_rms": 1.0,
            "check": {"distance_mm": 0.1, "angle_deg": 0.02},
            "head": {"extension_mm": 62.4, "turned_deg": 1.3, "beside_mm": 0.7},
        }
        | changes
    )
    return file.model_dump(mode="json", by_alias=True)


def test_the_case_has_the_file_that_the_command_writes_for_the_robot(room: Room) -> None:
    answer = room.post("/cases", samples.case_body(hexapod="hexapod-h70", guide_calibration=printed())).json()
    assert answer["guide_calibrated"] is True
    assert answer["hexapod"]["name"] == "hexapod-h70"
    content = room.gateway.record.document(answer["hexapod"]["sha256"])
    written = hexapod_json_with_head(read_part_file(DEFAULT_HEXAPOD), FOUND.matrix, 62.0)
    assert hexapod_from_json(content).sha256 == hexapod_from_json(written).sha256
    np.testing.assert_allclose(hexapod_from_json(content).top_from_guide(62.0).matrix, FOUND.matrix, atol=1e-12)


@pytest.mark.parametrize(
    ("calibration", "code", "sentence"),
    [
        (
            printed(verdict="rejected", reasons=[{"code": "guide_bent", "message": "the guide is 3.0 mm off"}]),
            "guide_calibration_rejected",
            "the guide's calibration was rejected: the guide is 3.0 mm off",
        ),
        (
            printed(hexapod_sha256="b" * 64),
            "guide_calibration_mismatch",
            "made with hexapod file bbbbbbbbbbbb, the case names 'hexapod-h70'",
        ),
        (printed() | {"head": 1}, "part_file_invalid", "head: Input should be an object"),
        (
            printed(top_from_guide=np.diag([2.0, 1.0, 1.0, 1.0]).tolist()),
            "part_file_invalid",
            "guide calibration: top_from_guide",
        ),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(
    quiet_room: Room, calibration: dict[str, object], code: str, sentence: str
) -> None:
    body = samples.case_body(hexapod="hexapod-h70", guide_calibration=json.loads(json.dumps(calibration)))
    answer = quiet_room.post("/cases", body)
    assert (answer.status_code, answer.json()["code"]) == (422, code), answer.text
    assert sentence in answer.json()["detail"]


def test_a_change_names_the_hexapod_beside_the_calibration(room: Room) -> None:
    case_id = room.open_case()
    path = f"/cases/{case_id}"
    alone = room.patch(path, {"guide_calibration": printed()})
    assert (alone.status_code, alone.json()["code"]) == (422, "guide_calibration_mismatch")
    assert "none is given beside it" in alone.json()["detail"]
    both = room.patch(path, {"hexapod": "hexapod-h70", "guide_calibration": printed()})
    assert both.json()["guide_calibrated"] is True


CALIBRATED = {"hexapod": "hexapod-h70", "guide_calibration": printed()}


def test_the_nominal_hexapod_put_back_is_not_calibrated(room: Room) -> None:
    path = f"/cases/{room.open_case()}"
    nominal = room.get(path).json()["hexapod"]
    assert room.patch(path, CALIBRATED).json()["guide_calibrated"] is True
    put_back = room.patch(path, {"hexapod": "hexapod-h70"}).json()
    assert (put_back["hexapod"], put_back["guide_calibrated"]) == (nominal, False)
    setups = [e.data.setup for e in room.gateway.record.events_after(0) if isinstance(e.data, SetupChanged)]
    assert [setup.guide_calibrated for setup in setups] == [True, False]
    assert room.patch(path, CALIBRATED).json()["guide_calibrated"] is True


def test_the_guide_in_use_given_again_replaces_nothing(room: Room) -> None:
    path = f"/cases/{room.open_case()}"
    calibrated = room.patch(path, CALIBRATED).json()
    same = room.patch(path, {"guide": samples.guide_file()}).json()
    assert (same["guide_calibrated"], same["revision"]) == (True, calibrated["revision"])
    other = room.patch(path, {"guide": samples.guide_file() | {"ball_count": 16}}).json()
    assert other["guide_calibrated"] is False
