"""Settings of a service: what it is started with, environment before file before default.

A setting ``room`` of imaging is read from, in this order: the arguments of `load_settings`, ``DISTALOCK_IMAGING_ROOM``,
``DISTALOCK_ROOM``, the table ``[imaging]`` and then the top level of the TOML file that ``DISTALOCK_CONFIG`` names.
"""

import os
import tomllib
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeVar, get_args

from pydantic import Field, ValidationError
from pydantic_settings import (
    BaseSettings,
    EnvSettingsSource,
    InitSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from shared.bus.settings import BusSettings
from shared.bus.tls import SCHEME, TlsFiles
from shared.errors import ConfigurationError
from shared.messages.base import Identifier
from shared.messages.presence import ServiceName
from shared.runtime.variables import CONFIG_VARIABLE, PREFIX, misspelt_common, misspelt_own

LogLevel = Literal["debug", "info", "warning", "error"]
SECTIONS: frozenset[str] = frozenset((*get_args(ServiceName), "simulation"))
ANNOUNCE_VARIABLE = "DISTALOCK_ANNOUNCE_FREE_PERCENT"


class ServiceSettings(BaseSettings):
    """What every service needs to know; each service derives its own and sets `section`.

    Attributes
    ----------
    section
        Name of the service's table in the file, and (in capitals) of its variables.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, frozen=True, extra="forbid", env_nested_delimiter="__")
    section: ClassVar[str] = ""

    room: Identifier = Field("or1", description="Operating room: part of every key on the bus.")
    router_endpoint: str = Field(
        "tls/127.0.0.1:7447", description="Where the router listens; tcp/... is without TLS and access control."
    )
    router_timeout_s: Annotated[float, Field(gt=0.0, le=300.0)] = Field(10.0, description="How long to wait for it.")
    state_dir: Path = Field(
        Path.home() / ".local" / "state" / "distalock", description="Folder for all that outlives a process."
    )
    tls_authority: Path | None = Field(
        None,
        description="Certificate of the authority; default: in the folder pki of the state folder, as those below.",
    )
    tls_certificate: Path | None = Field(None, description="Certificate of this service.")
    tls_key: Path | None = Field(None, description="Private key of this service.")
    log_level: LogLevel = Field("info", description="What is logged: this and everything more serious.")
    log_file: Path | None = Field(None, description="File for the log, which rotates; default: standard error.")
    health_file: Path | None = Field(
        None, description="File in memory (a tmpfs) for a container's health check: each heartbeat is noted there."
    )
    least_free_mib: Annotated[float, Field(ge=0.0)] = Field(
        64.0, description="Free space below which the state folder's disk counts as nearly full."
    )
    announce_free_percent: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        10.0, description="Free share of the state folder's disk below which it is announced and no new case is opened."
    )
    announce_free_mib: Annotated[float, Field(ge=0.0)] = Field(
        10240.0, description="Free space that is enough, whatever its share of a large disk."
    )

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - the signature is pydantic-settings'
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003 - likewise
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Arguments, the service's variables, common variables, the file."""
        own = EnvSettingsSource(settings_cls, env_prefix=f"{PREFIX}{cls.section.upper()}_")
        own_first = (init_settings, own) if cls.section else (init_settings,)
        return (*own_first, env_settings, InitSettingsSource(settings_cls, file_values(cls.section)))


def bus_settings(name: ServiceName, settings: ServiceSettings) -> BusSettings:
    """How a service reaches the bus, and with which files it proves who it is."""
    if not settings.router_endpoint.startswith(SCHEME):
        return BusSettings(settings.router_endpoint, settings.router_timeout_s)
    made = TlsFiles.in_state(settings.state_dir, name)
    files = TlsFiles(
        settings.tls_authority or made.authority,
        settings.tls_certificate or made.certificate,
        settings.tls_key or made.key,
    )
    return BusSettings(settings.router_endpoint, settings.router_timeout_s, files)


S = TypeVar("S", bound=ServiceSettings)


def load_settings(kind: type[S], **given: object) -> S:
    """Read a service's settings; `given` (from a command line) goes before all else, None meaning not given.

    Raises
    ------
    ConfigurationError
        With one sentence that names the first wrong setting, or a variable of the environment that is none.
    """
    own = misspelt_own(kind.section, kind.model_fields) if kind.section else None
    if (wrong := own or misspelt_common(ServiceSettings.model_fields, SECTIONS)) is not None:
        raise ConfigurationError(wrong)
    values = {name: value for name, value in given.items() if value is not None}
    try:
        return kind(**values)  # type: ignore[arg-type]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(p) for p in first["loc"]) or "settings"
        raise ConfigurationError(f"setting '{place}': {first['msg']}, got {first['input']!r}") from None


def file_values(section: str) -> dict[str, object]:
    """Values of the TOML file that ``DISTALOCK_CONFIG`` names, for one section; nothing when the variable is not set.

    Raises
    ------
    ConfigurationError
        When the file cannot be read, or has a table that is no service's.
    """
    name = os.environ.get(CONFIG_VARIABLE)
    if not name:
        return {}
    content = _toml(Path(name))
    tables = {key: value for key, value in content.items() if isinstance(value, dict)}
    if unknown := sorted(tables.keys() - SECTIONS):
        raise ConfigurationError(f"{name}: unknown table [{unknown[0]}]; known are {', '.join(sorted(SECTIONS))}")
    common = {key: value for key, value in content.items() if key not in tables}
    return {**common, **tables.get(section, {})}


def _toml(file: Path) -> dict[str, object]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{file}: not TOML: {error}") from None
