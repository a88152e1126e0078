"""`python -m distalock.prepare`: compile the numerical kernels after installing, so that no first image is a slow one.

The compiler keeps its results beside the sources. Rendering some scenes of the virtual room, localising two and
verifying the wires in one calls every kernel with the types that it will be called with later; the library of kernels
in images knows no others (`deploy/kernel_library.py`).
"""

import sys
import tempfile
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import cv2

from distalock.locate import NominalOptions, locate_image, read_parts
from distalock.verify import verify_images
from services.registration.core.localise import Parts
from simulation.render.image import render_scene
from simulation.room.drilling import insert_wire
from simulation.scenario.files import ScenarioFile
from simulation.scenario.sampling import scenario_from_file, scenario_of_seed
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, starting_state

SEED: Final = 2
# Rays through slots are compiled apart.
SLOTTED_NAIL: Final = "nail-femur-ti-11-slot"
SLOTTED_SEED: Final = 3


def compile_kernels() -> str:
    """Render and localise two scenes, and verify wires; the worse verdict, as a sign that the installation works."""
    slotted = ScenarioFile.model_validate(
        {"schema": "distalock/scenario/1", "seed": SLOTTED_SEED, "nail": SLOTTED_NAIL}
    )
    scenarios = (scenario_of_seed(SEED), scenario_from_file(slotted, Path()))
    with tempfile.TemporaryDirectory() as folder:
        verdicts = [_located(scenario, Path(folder)) for scenario in scenarios]
        _verify(scenarios[0], Path(folder))
    return max(verdicts)


def _located(scenario: Scenario, folder: Path) -> str:
    return locate_image(_image(scenario, starting_state(scenario), folder), _parts(scenario)).message.verdict


def _verify(scenario: Scenario, folder: Path) -> None:
    """Wires before the guide was aligned: that they are off is what is found."""
    state = starting_state(scenario)
    rods = tuple(insert_wire(scenario, state, hole_id).rod for hole_id in scenario.parts.common_hole_ids)
    image = _image(scenario, replace(state, wires=rods), folder)
    verify_images((image,), _parts(scenario), NominalOptions())


def _image(scenario: Scenario, state: WorldState, folder: Path) -> Path:
    file = folder / "image.png"
    cv2.imwrite(str(file), render_scene(scenario, state).pixels)
    return file


def _parts(scenario: Scenario) -> Parts:
    names = (scenario.sources.ring.name, scenario.sources.guide.name, scenario.sources.nail.name)
    with as_file(files("shared.parts") / "catalogue") as catalogue:
        ring, guide, nail = (catalogue / f"{name}.json" for name in names)
        return read_parts(ring, guide, nail)


if __name__ == "__main__":
    sys.exit(0 if compile_kernels() == "accepted" else "the installation's own test image was not accepted")
