"""Settings of the virtual operating room."""

import argparse
from pathlib import Path

import pytest

from shared.errors import ConfigurationError
from simulation.dicom.target import DicomTarget
from simulation.settings import (
    OF_THE_INSTALLATION,
    add_room_arguments,
    room_arguments,
    virtual_room_settings,
)


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
        ({"seed": 1, "scenario": Path(__file__)}, "a seed and a scenario file were both given; give one of them"),
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


def test_an_option_is_declared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # Options, their checks and the environment's variables follow from the fields.
    parser = argparse.ArgumentParser()
    add_room_arguments(parser)
    given = parser.parse_args(["--gcs-port", "0", "--seed", "3"])
    assert (given.gcs_port, given.seed, given.scenario, given.control_port) == (0, 3, None, None)
    assert room_arguments(given) == ("--gcs-port", "0", "--seed", "3")
    assert room_arguments(given, OF_THE_INSTALLATION) == ("--seed", "3")
    monkeypatch.setenv("DISTALOCK_SIMULATION_CONTROL_PORT", "1234")
    settings = virtual_room_settings(gcs_port=0)
    assert (settings.gcs_port, settings.control_port) == (0, 1234)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--seed", "-1"], "argument --seed: '-1': Input should be greater than or equal to 0"),
        (["--seed", "²"], "argument --seed: '²': Input should be a valid integer"),
        (["--scenario", "none.json"], "argument --scenario: 'none.json': file none.json does not exist"),
        (["--scenario", "."], "argument --scenario: '.': . is a folder; name a file in it"),
        (["--dicom-target", "nowhere"], "argument --dicom-target: 'nowhere': 'nowhere' is no DICOM target; write"),
    ],
)
def test_a_wrong_option_is_refused(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_room_arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(arguments)
    assert sentence in capsys.readouterr().err
