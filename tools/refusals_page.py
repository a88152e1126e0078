"""`docs/refusals.md`: every acceptance criterion of the services in one table."""

import importlib
import importlib.util
import pkgutil
from collections.abc import Iterator
from enum import StrEnum
from types import ModuleType
from typing import Any

import services
from services.robot.core.refusals import CRITERIA
from shared.acceptance import Criterion, Finding, Sense

_SENSES = {Sense.AT_MOST: "at most", Sense.AT_LEAST: "at least"}
_HEAD = """# Why an image, a frame or a plan is refused

Look up the `code` of a refusal: what was measured, the limit, and what to do. A refusal's sentence quotes the measured
value with its limit: "limit" is the largest acceptable value, "at least" the smallest; a value that is no number is
never acceptable. One code may have several rows, and one image several reasons. "where" is the module that declares the
criterion: each limit stands there and nowhere else, with its origin. This page is
printed from those declarations by `make generated`.

| code | measured | limit | unit | remedy | where |
|---|---|---|---|---|---|
"""
_ROBOT_HEAD = """
## Commands to the robot

The robot service answers a command that it does not carry out with one of these codes. "limit" is what it accepts;
settings of the service that change a limit are named. The table is `services/robot/core/refusals.py`.

| code | checked | limit | remedy |
|---|---|---|---|
"""


def refusals_page() -> str:
    """The page, sorted by code."""
    rows = sorted(_row(criterion, where) for where, criterion in declared_criteria())
    return _HEAD + "".join(f"{row}\n" for row in rows) + _robot_section()


def _robot_section() -> str:
    """The codes with which the robot service answers a command."""
    rows = (f"| `{c.code}` | {c.checked} | {c.limit} | {c.remedy} |\n" for c in CRITERIA.values())
    return _ROBOT_HEAD + "".join(rows)


def declared_criteria() -> Iterator[tuple[str, Criterion[Any] | Finding[Any]]]:
    """Every criterion of every service, with the module that declares it: its name must be annotated there."""
    for module in acceptance_modules():
        where = module.__name__.removeprefix("services.").replace(".", "/") + ".py"
        for name in module.__annotations__:
            value = getattr(module, name)
            if isinstance(value, Criterion | Finding):
                yield where, value


def acceptance_modules() -> Iterator[ModuleType]:
    """The modules under `core/acceptance` of every service."""
    for service in pkgutil.iter_modules(services.__path__, "services."):
        name = f"{service.name}.core.acceptance"
        if importlib.util.find_spec(f"{service.name}.core") is None or importlib.util.find_spec(name) is None:
            continue
        package = importlib.import_module(name)
        yield package
        for module in pkgutil.iter_modules(getattr(package, "__path__", ()), f"{name}."):
            yield importlib.import_module(module.name)


def _row(criterion: Criterion[StrEnum] | Finding[StrEnum], where: str) -> str:
    if isinstance(criterion, Finding):
        cells = [criterion.observed, "", ""]
    else:
        number = f"{_SENSES[criterion.limit.sense]} {round(criterion.limit.scale * criterion.limit.value, 9):g}"
        cells = [
            criterion.measured,
            f"{number}; {criterion.depends}" if criterion.depends else number,
            criterion.limit.unit,
        ]
    return "| " + " | ".join([f"`{criterion.code}`", *cells, criterion.remedy, f"`{where}`"]) + " |"
