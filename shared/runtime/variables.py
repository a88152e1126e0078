"""Variables of the environment that are settings: their names, and those that are misspelt."""

import os
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Final

PREFIX: Final = "DISTALOCK_"
CONFIG_VARIABLE: Final = f"{PREFIX}CONFIG"
_NESTED: Final = "__"
# Chosen: two letters changed places or one is missing; names share their beginning, which counts.
_ALIKE: Final = 0.85
# Read by other programs than services: the compose file, `distalock up`, benchmarks on the independent images.
OTHER_VARIABLES: Final = frozenset(
    f"{PREFIX}{name}"
    for name in (
        "ARCHIVE_ADDRESS",
        "BASE_IMAGE",
        "CONTROL_ADDRESS",
        "CONTROLLER_URL",
        "DICOM_ADDRESS",
        "DICOM_TLS",
        "ENVIRONMENT",
        "FLUOROSCOPY",
        "HTTPS",
        "MEMLOCK",
        "PARENT_PIPE",
        "PIP_INDEX_URL",
        "PLAIN_HTTP",
        "RECORD",
        "REST_ADDRESS",
        "REVISION",
        "RTPRIO",
        "SEED",
        "SITE",
        "SITE_KEYS",
        "VERSION",
    )
)


def variable_of(section: str, name: str) -> str:
    """The variable of a setting; `section` is empty for those of all services."""
    return f"{PREFIX}{section.upper()}_{name.upper()}" if section else f"{PREFIX}{name.upper()}"


def misspelt_own(section: str, own: Iterable[str], environment: Mapping[str, str] | None = None) -> str | None:
    """A sentence on the first variable that begins as those of one program and is none of its settings, else None."""
    known = {variable_of(section, name) for name in own}
    found = (name for name in _variables(environment) if name.startswith(variable_of(section, "")))
    return next((_sentence(name, section, known) for name in found if name not in known), None)


def misspelt_common(
    common: Iterable[str], sections: Iterable[str], environment: Mapping[str, str] | None = None
) -> str | None:
    """The same of variables that begin as those of no program; the settings of each are for that one to judge."""
    known = {variable_of("", name) for name in common} | OTHER_VARIABLES | {CONFIG_VARIABLE}
    own = tuple(variable_of(section, "") for section in sections)
    found = (name for name in _variables(environment) if not name.startswith(own))
    return next((_sentence(name, "distalock", known) for name in found if name not in known), None)


def _sentence(name: str, whose: str, known: Iterable[str]) -> str:
    near = get_close_matches(name, known, n=1, cutoff=_ALIKE)
    meant = f"did you mean {near[0]}?" if near else "docs/settings.md lists them"
    return f"the variable {name} is no setting of {whose}; {meant}"


def _variables(environment: Mapping[str, str] | None) -> Iterator[str]:
    for name in sorted(os.environ if environment is None else environment):
        if name.upper().startswith(PREFIX):
            yield name.upper().partition(_NESTED)[0]
