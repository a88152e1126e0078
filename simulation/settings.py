"""What the virtual operating room is started with."""

import re
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from shared.errors import ConfigurationError
from simulation.dicom_sender import DicomTarget

Port: TypeAlias = Annotated[int, Field(ge=0, le=65535)]
_TARGET = re.compile(r"(?:(?P<title>[^@]{1,16})@)?(?P<host>[^@:\s]+):(?P<port>\d{1,5})")


class VirtualRoomSettings(BaseModel):
    """Settings of the virtual operating room.

    Attributes
    ----------
    gcs_port
        TCP port of the hexapod's controller; 0 picks a free one. It is served on a pseudo-terminal as well.
    control_port
        TCP port of the control API; 0 picks a free one.
    dicom_target
        ``[TITLE@]HOST:PORT`` to which images are sent; None keeps them in the room.
    seed, scenario
        Which scenario to play: a seed or a file, not both; seed 0 when neither is given.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: Annotated[str, Field(min_length=1)] = "127.0.0.1"
    gcs_port: Port = 50000
    control_port: Port = 8900
    dicom_target: str | None = None
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] | None = None
    scenario: Path | None = None

    @model_validator(mode="after")
    def _one_scenario(self) -> "VirtualRoomSettings":
        if self.seed is not None and self.scenario is not None:
            raise ValueError("a seed and a scenario file were both given; give one of them")
        if self.dicom_target is not None:
            parse_target(self.dicom_target)
        return self

    @property
    def target(self) -> DicomTarget | None:
        """Where images are sent."""
        return None if self.dicom_target is None else parse_target(self.dicom_target)


def parse_target(text: str) -> DicomTarget:
    """Read ``[TITLE@]HOST:PORT``; raises `ValueError`."""
    found = _TARGET.fullmatch(text)
    if found is None or not 0 < int(found["port"]) <= 65535:
        raise ValueError(f"'{text}' is no DICOM target; write [TITLE@]HOST:PORT, for example 127.0.0.1:11112")
    if found["title"] is None:
        return DicomTarget(found["host"], int(found["port"]))
    return DicomTarget(found["host"], int(found["port"]), found["title"])


def virtual_room_settings(**given: object) -> VirtualRoomSettings:
    """Settings from a command line; None means not given.

    Raises
    ------
    ConfigurationError
        With one sentence that names the first wrong setting.
    """
    try:
        return VirtualRoomSettings.model_validate({k: v for k, v in given.items() if v is not None})
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(p) for p in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise ConfigurationError(f"setting '{place}': {message}" if place else message) from None
