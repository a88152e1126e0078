"""Find the parts of a scenario: in the catalogue that the product ships, or as files beside the scenario."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from shared.errors import PartFileInvalid
from shared.parts.catalogue import PartKind, catalogue_entry, catalogue_names
from shared.parts.files import guide_from_json, nail_from_json, read_part_file, ring_from_json
from shared.parts.hexapod_file import hexapod_from_json
from simulation.scenario.bones import BoneKind
from simulation.scenario.files import ScenarioFile, ScenarioInvalid
from simulation.scenario.values import Parts, PartSource, PartSources

P = TypeVar("P")


# What seeds pick from, apart from the catalogue: a part added to the catalogue must not change what a seed makes.
DRAWN_BY_SEEDS: Mapping[PartKind, tuple[str, ...]] = {
    "ring": ("ring-120",),
    "guide": ("guide-28",),
    "nail": ("nail-femur-steel-11", "nail-femur-steel-12", "nail-femur-ti-10", "nail-femur-ti-11"),
    "hexapod": ("hexapod-h70",),
}


_TIBIAL_NAILS = ("nail-tibia-ti-10",)


def choose_parts(file: ScenarioFile, folder: Path, generator: np.random.Generator) -> tuple[Parts, PartSources]:
    """Read the parts that a scenario names; what it leaves open, the generator picks from `DRAWN_BY_SEEDS`.

    Parameters
    ----------
    folder
        Where relative paths start.

    Raises
    ------
    ScenarioInvalid
        When a part is neither in the catalogue nor a readable, valid file, or the nail is made for another bone.
    """
    nails = _TIBIAL_NAILS if file.bone is BoneKind.TIBIA else None
    sources = PartSources(
        ring=_source(_name(file.ring, "ring", generator), "ring", folder),
        guide=_source(_name(file.guide, "guide", generator), "guide", folder),
        nail=_source(_name(file.nail, "nail", generator, nails), "nail", folder),
        hexapod=_source(_name(file.hexapod, "hexapod", generator), "hexapod", folder),
    )
    parts = Parts(
        ring=_parsed(ring_from_json, sources.ring),
        guide=_parsed(guide_from_json, sources.guide),
        nail=_parsed(nail_from_json, sources.nail),
        hexapod=_parsed(hexapod_from_json, sources.hexapod),
    )
    made_for = parts.nail.bone
    if made_for is not None and made_for != file.bone.value:
        raise ScenarioInvalid(
            f"nail '{sources.nail.name}' is made for the {made_for}, and the scenario's bone is the {file.bone.value}: "
            f'name it ("bone": "{made_for}"), or another nail'
        )
    return parts, sources


def _name(
    given: str | None, kind: PartKind, generator: np.random.Generator, among: tuple[str, ...] | None = None
) -> str:
    # Drawn even when the name is given, so that the choices that follow do not depend on it.
    pick = generator.random()
    names = among or DRAWN_BY_SEEDS[kind]
    return names[int(pick * len(names))] if given is None else given


def _source(name: str, kind: PartKind, folder: Path) -> PartSource:
    entry = catalogue_entry(name)
    if entry is not None and entry.kind == kind:
        return PartSource(name, in_catalogue=True, content=entry.content)
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
