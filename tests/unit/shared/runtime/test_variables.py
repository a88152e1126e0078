"""Variables that begin with DISTALOCK_ and are no setting are named, with the one that was meant."""

import re
from pathlib import Path

import pytest

from shared.runtime.settings import SECTIONS, ServiceSettings
from shared.runtime.variables import OTHER_VARIABLES, misspelt_common, misspelt_own, variable_of

OWN = ("room", "dicom_port")
COMPOSE = Path(__file__).parents[4] / "docker-compose.yml"


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("DISTALOCK_IMAGING_DICOM_PROT", "did you mean DISTALOCK_IMAGING_DICOM_PORT?"),
        ("DISTALOCK_IMAGING_ROOMS", "did you mean DISTALOCK_IMAGING_ROOM?"),
        ("distalock_imaging_colour", "docs/settings.md lists them"),
    ],
)
def test_a_misspelt_variable_of_a_service_is_named(name: str, meant: str) -> None:
    sentence = misspelt_own("imaging", OWN, {name: "1", "DISTALOCK_IMAGING_DICOM_PORT": "1"})
    assert sentence == f"the variable {name.upper()} is no setting of imaging; {meant}"


@pytest.mark.parametrize(
    ("name", "meant"), [("DISTALOCK_ROM", "DISTALOCK_ROOM"), ("DISTALOCK_LOGLEVEL", "DISTALOCK_LOG_LEVEL")]
)
def test_a_misspelt_variable_of_all_services_is_named(name: str, meant: str) -> None:
    sentence = misspelt_common(ServiceSettings.model_fields, SECTIONS, {name: "1"})
    assert sentence == f"the variable {name} is no setting of distalock; did you mean {meant}?"


def test_what_others_read_is_none_of_ours() -> None:
    environment = dict.fromkeys(
        ("PATH", "DISTALOCK_ROOM", "DISTALOCK_CONFIG", "DISTALOCK_ROBOT_ANYTHING", "DISTALOCK_HTTPS"), "1"
    )
    assert misspelt_own("imaging", OWN, environment) is None
    assert misspelt_common(ServiceSettings.model_fields, SECTIONS, environment) is None


def test_variables_of_the_compose_file_are_known() -> None:
    used = set(re.findall(r"\$\{(DISTALOCK_\w+)", COMPOSE.read_text(encoding="utf-8")))
    common = {variable_of("", name) for name in ServiceSettings.model_fields}
    assert used - common <= OTHER_VARIABLES
