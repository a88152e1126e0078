"""Help of a service: every setting with its variable, its default and what it is."""

from typing import ClassVar

import pytest
from pydantic import Field

from shared.runtime.help import service_parser, settings_help
from shared.runtime.settings import ServiceSettings


class LampSettings(ServiceSettings):
    section: ClassVar[str] = "imaging"
    lamps: int = Field(3, description="How many lamps.")


def test_every_setting_has_its_variable() -> None:
    lines = settings_help(LampSettings).splitlines()
    assert "  DISTALOCK_ROOM  or1  Operating room: part of every key on the bus." in lines
    assert "  DISTALOCK_IMAGING_LAMPS  3  How many lamps." in lines
    assert len(lines) == len(LampSettings.model_fields) + 2


def test_a_service_takes_no_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    parser = service_parser("imaging", LampSettings)
    parser.parse_args([])
    with pytest.raises(SystemExit):
        parser.parse_args(["--lamps", "4"])
    assert "unrecognized arguments: --lamps 4" in capsys.readouterr().err
