"""What the virtual operating room is started with: each option is declared once, as a field of `VirtualRoomSettings`.

From a field follow the option of `python -m simulation`, `distalock virtual-or`, `demo` and `up --simulate`
(``--gcs-port``), its help, its check, and the variable of the environment (``DISTALOCK_SIMULATION_GCS_PORT``).
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, SettingsConfigDict

from shared.errors import ConfigurationError
from shared.runtime.variables import misspelt_own
from simulation.dicom.target import DicomTarget, parse_target
from simulation.scenario.bones import BoneKind

_ONE_OF = frozenset({"seed", "scenario"})
# What an installation of several processes decides itself.
OF_THE_INSTALLATION = frozenset({"host", "gcs_port", "control_port", "dicom_target"})


def _existing(file: Path) -> Path:
    if file.is_dir():
        raise ValueError(f"{file} is a folder; name a file in it")
    if not file.is_file():
        raise ValueError(f"file {file} does not exist")
    return file.resolve()


def _sendable(target: str) -> str:
    parse_target(target)
    return target


Port: TypeAlias = Annotated[int, Field(ge=0, le=65535)]
ExistingFile: TypeAlias = Annotated[Path, AfterValidator(_existing)]
TargetText: TypeAlias = Annotated[str, AfterValidator(_sendable)]
Seed: TypeAlias = Annotated[int, Field(ge=0, le=2**63 - 1)]


class VirtualRoomSettings(BaseSettings):
    """Settings of the virtual operating room."""

    model_config = SettingsConfigDict(env_prefix="DISTALOCK_SIMULATION_", frozen=True, extra="forbid")

    host: Annotated[str, Field(min_length=1)] = Field("127.0.0.1", description="interface to listen on")
    gcs_port: Port = Field(
        50000, description="TCP port of the hexapod's controller, which a pseudo-terminal serves as well; 0: any free"
    )
    gcs_baud: Annotated[int, Field(ge=1200, le=4_000_000)] | None = Field(
        None, description="bits per second of the line to the controller; bytes take no time without it"
    )
    control_port: Port = Field(8900, description="TCP port of the control API; 0: any free")
    dicom_target: TargetText | None = Field(
        None, description="[TITLE@]HOST:PORT to send images to; they stay in the room without it"
    )
    seed: Seed | None = Field(None, description="seed of a random scenario; 0 without seed and scenario file")
    bone: BoneKind | None = Field(None, description="femur or tibia, of a scenario by seed; femur without it")
    scenario: ExistingFile | None = Field(None, description="scenario file, instead of a seed")

    @model_validator(mode="after")
    def _one_scenario(self) -> "VirtualRoomSettings":
        if self.seed is not None and self.scenario is not None:
            raise ValueError("a seed and a scenario file were both given; give one of them")
        if self.bone is not None and self.scenario is not None:
            raise ValueError("a bone and a scenario file were both given; the file names the bone")
        return self

    @property
    def target(self) -> DicomTarget | None:
        """Where images are sent."""
        return None if self.dicom_target is None else parse_target(self.dicom_target)


def add_room_arguments(parser: argparse.ArgumentParser, leave_out: frozenset[str] = frozenset()) -> None:
    """Declare an option for each setting."""
    one_of = parser.add_mutually_exclusive_group()
    for name, field in VirtualRoomSettings.model_fields.items():
        if name not in leave_out:
            default = "" if field.default is None else f" ({field.default})"
            options = one_of if name in _ONE_OF else parser
            options.add_argument(_option(name), type=_parser_of(field), help=f"{field.description}{default}")


def room_arguments(given: argparse.Namespace, leave_out: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """The options that were given, as arguments of the virtual room's process."""
    values = {name: getattr(given, name, None) for name in VirtualRoomSettings.model_fields if name not in leave_out}
    return tuple(text for name, value in values.items() if value is not None for text in (_option(name), str(value)))


def virtual_room_settings(**given: object) -> VirtualRoomSettings:
    """Settings from a command line, None meaning not given, and from the environment.

    Raises
    ------
    ConfigurationError
        With one sentence that names the first wrong setting.
    """
    fields = VirtualRoomSettings.model_fields
    if (wrong := misspelt_own("simulation", fields)) is not None:
        raise ConfigurationError(wrong)
    known = {name: value for name, value in given.items() if name in fields}
    try:
        return VirtualRoomSettings(**{name: value for name, value in known.items() if value is not None})  # type: ignore[arg-type]
    except ValidationError as error:
        place = ".".join(str(p) for p in error.errors()[0]["loc"])
        message = _message(error)
        raise ConfigurationError(f"setting '{place}': {message}" if place else message) from None


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _parser_of(field: FieldInfo) -> Callable[[str], object]:
    """A parser of one option, for argparse."""
    adapter: TypeAdapter[object] = TypeAdapter(field.rebuild_annotation())

    def parse(text: str) -> object:
        try:
            return adapter.validate_python(text)
        except ValidationError as error:
            raise argparse.ArgumentTypeError(f"{text!r}: {_message(error)}") from None

    return parse


def _message(error: ValidationError) -> str:
    return error.errors()[0]["msg"].removeprefix("Value error, ")
