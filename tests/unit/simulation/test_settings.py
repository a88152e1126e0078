"""Settings of the virtual operating room."""

from pathlib import Path

import pytest

from shared.errors import ConfigurationError
from simulation.dicom_sender import DicomTarget
from simulation.settings import virtual_room_settings


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("127.0.0.1:11112", DicomTarget("127.0.0.1", 11112, "DISTALOCK")),
        ("PACS@hospital.example:104", DicomTarget("hospital.example", 104, "PACS")),
    ],
)
def test_targets_are_read(text: str, target: DicomTarget) -> None:
    assert virtual_room_settings(dicom_target=text).target == target


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"dicom_target": "nowhere"}, r"'nowhere' is no DICOM target; write \[TITLE@\]HOST:PORT"),
        ({"dicom_target": "host:70000"}, "no DICOM target"),
        ({"seed": 1, "scenario": Path("a.json")}, "a seed and a scenario file were both given; give one of them"),
        ({"gcs_port": 70000}, "setting 'gcs_port'"),
        ({"seed": -1}, "setting 'seed'"),
        ({"host": ""}, "setting 'host'"),
    ],
)
def test_wrong_settings_are_one_sentence(given: dict[str, object], sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        virtual_room_settings(**given)


def test_none_means_not_given() -> None:
    assert virtual_room_settings(seed=None, gcs_port=None).gcs_port == 50000
