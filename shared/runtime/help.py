"""What a service's process prints for `--help`: its settings, where they are read from, and their defaults."""

import argparse

from pydantic_core import PydanticUndefined

from shared.arguments import OneLineParser
from shared.messages.presence import ServiceName
from shared.runtime.settings import ServiceSettings
from shared.runtime.variables import CONFIG_VARIABLE, variable_of


def service_parser(name: ServiceName, kind: type[ServiceSettings]) -> OneLineParser:
    """A parser that takes no arguments: settings come from the environment and the configuration file."""
    return OneLineParser(
        prog=f"python -m services.{name}",
        description=f"The {name} service. It takes no arguments; its settings come from the environment.",
        epilog=settings_help(kind),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def settings_help(kind: type[ServiceSettings]) -> str:
    """One line a setting: its variable, its default and what it is."""
    lines = ["settings (variable, default, meaning):"]
    for name, field in kind.model_fields.items():
        variable = variable_of("" if name in ServiceSettings.model_fields else kind.section, name)
        default = "required" if field.default is PydanticUndefined else field.default
        lines.append(f"  {variable}  {default}  {field.description or ''}".rstrip())
    lines.append(f"{CONFIG_VARIABLE} names a TOML file with the same settings; variables go before it.")
    return "\n".join(lines)
