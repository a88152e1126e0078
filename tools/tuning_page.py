"""`docs/tuning.md`: every tuned value with its unit, its effect and where it comes from."""

import importlib
import importlib.util
import inspect
from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple, is_dataclass
from types import ModuleType

from shared.tuning import TunedValue, values_of

MODULES = (
    "services.imaging.core.tuning",
    "shared.xray.tuning",
    "services.registration.core.tuning",
    "services.robot.core.tuning",
)
_HEAD = """# Tuned values

Look up a value by the stage that reads it: its unit, what it does, and where it comes from. *Derived* values follow
from something else, *physical* ones from materials, devices or anatomy, *standard* ones are customary in the field,
*fitted* ones were chosen on the data that the last column names. {counts}

Lengths that end in `_detector_mm` are lengths at the detector; 0.235 mm there are one usual pixel, and an image with
another pixel pitch scales them (`shared/xray/pixel_scale.py`). `distalock bench sensitivity` measures what each value
does to verdicts and errors. Limits that refuse an image are not tuned values: they stand in
[refusals.md](refusals.md). This page is printed from the declarations by `make generated`.
"""


def tuning_page() -> str:
    """The page, module by module in the order of processing."""
    modules = [importlib.import_module(name) for name in MODULES if importlib.util.find_spec(name) is not None]
    counts = Counter(value.origin.provenance.value for module in modules for value in tuned_values(module))
    summary = ", ".join(f"{number} {provenance}" for provenance, number in sorted(counts.items()))
    return _HEAD.format(counts=f"There are {sum(counts.values())}: {summary}.") + "".join(map(_section, modules))


def tuned_values(module: ModuleType) -> Iterator[TunedValue]:
    """All values that a tuning module declares."""
    for group in module.SETTINGS:
        yield from values_of(group)


def _section(module: ModuleType) -> str:
    return f"\n## `{module.__name__.replace('.', '/')}.py`\n" + "".join(_table(group) for group in module.SETTINGS)


def _table(group: object) -> str:
    about = inspect.getdoc(type(group)) or ""
    rows = "".join(_row(value) for value in values_of(group))
    title = f"\n### {type(group).__name__}\n{about.split(chr(10))[0]}\n\n"
    return f"{title}| name | value | unit | effect | origin |\n|---|---|---|---|---|\n{rows}"


def _row(value: TunedValue) -> str:
    cells = (
        f"`{value.name}`",
        _printed(value.value),
        value.unit,
        value.effect,
        f"{value.origin.provenance.value}: {value.origin.source}",
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _printed(value: object) -> str:
    if is_dataclass(value) and not isinstance(value, type):
        value = astuple(value)
    if isinstance(value, tuple):
        return "(" + ", ".join(_printed(one) for one in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
