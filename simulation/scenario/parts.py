"""Find the parts of a scenario: in the catalogue that the product ships, or as files beside the scenario."""

from collections.abc import Callable
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TypeVar

import numpy as np

from shared.errors import PartFileInvalid
from shared.parts.files import guide_from_json, nail_from_json, read_part_file, ring_from_json
from shared.parts.hexapod_file import hexapod_from_json
from simulation.scenario.files import ScenarioFile, ScenarioInvalid
from simulation.scenario.values import Parts, PartSource, PartSources

P = TypeVar("P")


def _catalogue() -> Traversable:
    return files("shared.parts").joinpath("catalogue")


def catalogue_names(kind: str) -> tuple[str, ...]:
    """Names of the catalogue's parts of a kind (`ring`, `guide`, `nail`, `hexapod`), sorted."""
    names = [f.name.removesuffix(".json") for f in _catalogue().iterdir() if f.name.endswith(".json")]
    return tuple(sorted(n for n in names if n.startswith(f"{kind}-")))


def choose_parts(file: ScenarioFile, folder: Path, generator: np.random.Generator) -> tuple[Parts, PartSources]:
    """Read the parts that a scenario names; what it leaves open, the generator picks from the catalogue.

    Parameters
    ----------
    folder
        Where relative paths start.

    Raises
    ------
    ScenarioInvalid
        When a part is neither in the catalogue nor a readable, valid file.
    """
    sources = PartSources(
        ring=_source(_name(file.ring, "ring", generator), "ring", folder),
        guide=_source(_name(file.guide, "guide", generator), "guide", folder),
        nail=_source(_name(file.nail, "nail", generator), "nail", folder),
        hexapod=_source(_name(file.hexapod, "hexapod", generator), "hexapod", folder),
    )
    parts = Parts(
        ring=_parsed(ring_from_json, sources.ring),
        guide=_parsed(guide_from_json, sources.guide),
        nail=_parsed(nail_from_json, sources.nail),
        hexapod=_parsed(hexapod_from_json, sources.hexapod),
    )
    return parts, sources


def _name(given: str | None, kind: str, generator: np.random.Generator) -> str:
    names = catalogue_names(kind)
    # Drawn even when the name is given, so that the choices that follow do not depend on it.
    pick = generator.random()
    if given is not None:
        return given
    if not names:
        raise ScenarioInvalid(f"the catalogue holds no {kind}; name a {kind} file in the scenario")
    return names[int(pick * len(names))]


def _source(name: str, kind: str, folder: Path) -> PartSource:
    if name in catalogue_names(kind):
        return PartSource(name, in_catalogue=True, content=_catalogue().joinpath(f"{name}.json").read_bytes())
    try:
        return PartSource(name, in_catalogue=False, content=read_part_file(folder / name))
    except PartFileInvalid as error:
        known = ", ".join(catalogue_names(kind))
        raise ScenarioInvalid(f"{kind} '{name}': {error}; the catalogue has {known or 'none'}") from None


def _parsed(parse: Callable[[bytes, str], P], source: PartSource) -> P:
    try:
        return parse(source.content, source.name)
    except PartFileInvalid as error:
        raise ScenarioInvalid(str(error)) from None
