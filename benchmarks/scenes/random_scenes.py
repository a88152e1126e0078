"""Scenes drawn from their seeds, and what a localisation is told of them.

Every scene has its own ring and guide pattern and its own nail, so that nothing can be tuned to them; only those of the
catalogue have the parts that the product ships.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from benchmarks.scenes.varied_parts import write_parts
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.localise import Parts
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from simulation.scenario.files import ScenarioFile
from simulation.scenario.sampling import scenario_from_file
from simulation.scenario.values import Scenario

# Tilts up to the ten degrees at which a good image must still be accepted; more doses and displays than a case has.
_RANGES: dict[str, JsonValue] = {
    "placement": {"start_tilt_deg": [0.3, 10.0]},
    "c_arm": {"source_to_detector_mm": [900.0, 1050.0], "nail_to_detector_mm": [200.0, 300.0]},
    "exposure": {"photons_per_px": [200.0, 1400.0]},
    "display": {"mirrored_probability": 0.4, "eight_bits_probability": 0.3},
}


def scene_of_seed(seed: int) -> Scenario:
    """A scenario with random ring, guide and nail, and the ranges of all random scenes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = write_parts(folder, np.random.default_rng([seed, *b"varied parts"]))
        file = ScenarioFile.model_validate({"schema": "distalock/scenario/1", "seed": seed, "ranges": _RANGES, **parts})
        return scenario_from_file(file, folder)


def catalogue_scene_of_seed(seed: int) -> Scenario:
    """The same ranges with parts of the catalogue, whose guide and nails have their holes the same distance apart."""
    file = ScenarioFile.model_validate({"schema": "distalock/scenario/1", "seed": seed, "ranges": _RANGES})
    return scenario_from_file(file, Path())


def parts_of(scenario: Scenario) -> Parts:
    """The part files that a localisation gets: that of the nail does not say how its holes are chamfered."""
    nail = scenario.parts.nail
    silent = replace(nail, holes=tuple(replace(hole, chamfer_mm=None) for hole in nail.holes))
    return Parts(scenario.parts.ring, scenario.parts.guide, silent, USUAL_DRILL_DIAMETER_MM)


def shipped_parts_of(scenario: Scenario) -> Parts:
    """The part files as they are: for scenes with parts of the catalogue, whose files say how holes are chamfered."""
    return Parts(scenario.parts.ring, scenario.parts.guide, scenario.parts.nail, USUAL_DRILL_DIAMETER_MM)


def nominal_of(scenario: Scenario) -> NominalGeometry:
    """What the C-arm says of itself."""
    return NominalGeometry(scenario.c_arm.nominal_source_to_detector_mm, scenario.c_arm.nominal_pixel_mm)
