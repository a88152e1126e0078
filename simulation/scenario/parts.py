"""Find the parts of a scenario: in the catalogue that the product ships, or as files beside the scenario."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

import numpy as np

from shared.errors import PartFileInvalid
from shared.parts.files import guide_from_json, nail_from_json, read_part_file, ring_from_json
from shared.parts.hexapod_file import hexapod_from_json
from simulation.scenario.files import ScenarioFile, ScenarioInvalid
from simulation.scenario.values import PartNames, Parts

P = TypeVar("P")


def catalogue_names(kind: str) -> tuple[str, ...]:
    """Names of the catalogue's parts of a kind (`ring`, `guide`, `nail`, `hexapod`), sorted."""
    folder = files("shared.parts").joinpath("catalogue")
    names = [f.name.removesuffix(".json") for f in folder.iterdir() if f.name.endswith(".json")]
    return tuple(sorted(n for n in names if n.startswith(f"{kind}-")))


def choose_parts(file: ScenarioFile, folder: Path, generator: np.random.Generator) -> tuple[Parts, PartNames]:
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
    names = PartNames(
        ring=_name(file.ring, "ring", generator),
        guide=_name(file.guide, "guide", generator),
        nail=_name(file.nail, "nail", generator),
        hexapod=_name(file.hexapod, "hexapod", generator),
    )
    parts = Parts(
        ring=_read(ring_from_json, names.ring, "ring", folder),
        guide=_read(guide_from_json, names.guide, "guide", folder),
        nail=_read(nail_from_json, names.nail, "nail", folder),
        hexapod=_read(hexapod_from_json, names.hexapod, "hexapod", folder),
    )
    return parts, names


def _name(given: str | None, kind: str, generator: np.random.Generator) -> str:
    names = catalogue_names(kind)
    # Drawn even when the name is given, so that the choices that follow do not depend on it.
    pick = generator.random()
    if given is not None:
        return given
    if not names:
        raise ScenarioInvalid(f"the catalogue holds no {kind}; name a {kind} file in the scenario")
    return names[int(pick * len(names))]


def _read(parse: Callable[[bytes, str], P], name: str, kind: str, folder: Path) -> P:
    in_catalogue = files("shared.parts").joinpath("catalogue").joinpath(f"{name}.json")
    try:
        if "/" not in name and in_catalogue.is_file():
            return parse(in_catalogue.read_bytes(), name)
        return parse(read_part_file(folder / name), str(folder / name))
    except PartFileInvalid as error:
        known = ", ".join(catalogue_names(kind))
        raise ScenarioInvalid(f"{kind} '{name}': {error}; the catalogue has {known or 'none'}") from None
