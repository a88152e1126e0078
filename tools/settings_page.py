"""`docs/settings.md`: every setting, from the classes that read them."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from services.imaging.settings import ImagingSettings
from services.registration.settings import RegistrationSettings
from services.robot.settings import RobotSettings
from services.ui_api.settings import UiApiSettings
from shared.runtime.settings import ServiceSettings
from shared.runtime.variables import variable_of
from simulation.settings import VirtualRoomSettings

_HEAD = """# Settings

Set a variable of the environment, or write the same name without its prefix into a TOML file and name that file in
`DISTALOCK_CONFIG`:

```toml
room = "or2"              # DISTALOCK_ROOM, for all services

[imaging]
dicom_port = 104          # DISTALOCK_IMAGING_DICOM_PORT
```

What a command line gives goes before variables, the variable of one service (`DISTALOCK_IMAGING_ROOM`) before that of
all, variables before the file, a service's table before the file's top level. Lists are JSON (`["CARM", "CARM2"]`).
A variable that begins with `DISTALOCK_` and is no setting is an error that names the one that was meant; so is an
unknown name in the file, and a value beyond its limits. Every service prints its own with `--help`.
"""
_TABLE = "| variable | default | limits | meaning |\n|---|---|---|---|\n"
_SERVICES: tuple[tuple[str, type[ServiceSettings]], ...] = (
    ("Imaging", ImagingSettings),
    ("Registration", RegistrationSettings),
    ("Robot", RobotSettings),
    ("Gateway", UiApiSettings),
)
_BOUNDS = (
    ("gt", "> "),
    ("ge", "at least "),
    ("lt", "< "),
    ("le", "at most "),
    ("min_length", "length at least "),
    ("max_length", "length at most "),
)


def settings_page() -> str:
    """The page as it must be."""
    common = ServiceSettings.model_fields
    parts = [_HEAD, "\n## All services\n\n", _table("", common)]
    for title, kind in _SERVICES:
        own = {name: field for name, field in kind.model_fields.items() if name not in common}
        parts += [f"\n## {title}\n\n", _table(kind.section, own)]
    parts += [
        "\n## Virtual operating room\n\nEach is an option of the command as well ([commands.md](commands.md)).\n\n"
    ]
    parts += [_table("simulation", VirtualRoomSettings.model_fields)]
    return "".join(parts)


def _table(section: str, fields: Mapping[str, FieldInfo]) -> str:
    rows = (
        f"| `{variable_of(section, name)}` | {_default(field)} | {_limits(field)} | {_meaning(name, field)} |\n"
        for name, field in fields.items()
    )
    return _TABLE + "".join(rows)


def _meaning(name: str, field: FieldInfo) -> str:
    if not field.description:
        raise ValueError(f"setting {name} has no description")
    text = field.description[0].upper() + field.description[1:]
    return text if text.endswith(".") else f"{text}."


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined:
        return "required"
    if value is None or value in ((), ""):
        return ""
    if isinstance(value, Path):
        return f"`{_portable(value)}`"
    if isinstance(value, tuple):
        return f"`{json.dumps([str(one) for one in value])}`"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _portable(path: Path) -> str:
    """Without what differs from machine to machine."""
    if path.is_relative_to(Path.home()):
        return f"~/{path.relative_to(Path.home())}"
    root = Path(__file__).parents[1]
    return str(path.relative_to(root)) if path.is_relative_to(root) else str(path)


def _limits(field: FieldInfo) -> str:
    found = [*_bounds(field.metadata), *_choices(field.annotation)]
    return ", ".join(dict.fromkeys(found))


def _bounds(metadata: list[object]) -> Iterator[str]:
    for one in metadata:
        for attribute, words in _BOUNDS:
            if (bound := getattr(one, attribute, None)) is not None:
                yield f"{words}{bound:,}" if isinstance(bound, int) else f"{words}{bound:g}"
        for nested in getattr(one, "metadata", ()):
            yield from _bounds([nested])


def _choices(annotation: object) -> Iterator[str]:
    """Words that a setting may have, and bounds of what may be None or is in a list."""
    if get_origin(annotation) is Literal:
        yield from (f"`{word}`" for word in get_args(annotation))
    elif isinstance(annotation, type) and issubclass(annotation, str) and hasattr(annotation, "__members__"):
        yield from (f"`{member.value}`" for member in annotation)  # type: ignore[attr-defined]
    elif get_origin(annotation) in (Union, UnionType):
        for one in get_args(annotation):
            if one is not NoneType:
                yield from _bounds(list(getattr(one, "__metadata__", ())))
                yield from _choices(one)
