"""`python -m distalock.prepare`: compile the numerical kernels after installing, so that no first image is a slow one.

The compiler keeps its results beside the sources. Rendering two scenes of the virtual room and localising them calls
every kernel with the types that it will be called with later.
"""

import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import cv2

from distalock.locate import locate_image, read_parts
from simulation.render.image import render_scene
from simulation.scenario.files import ScenarioFile
from simulation.scenario.sampling import scenario_from_file, scenario_of_seed
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

SEED: Final = 2
# Rays through slots are compiled apart.
SLOTTED_NAIL: Final = "nail-femur-ti-11-slot"
SLOTTED_SEED: Final = 3


def compile_kernels() -> str:
    """Render and localise two scenes; the worse verdict, as a sign that the installation works."""
    slotted = ScenarioFile.model_validate(
        {"schema": "distalock/scenario/1", "seed": SLOTTED_SEED, "nail": SLOTTED_NAIL}
    )
    scenarios = (scenario_of_seed(SEED), scenario_from_file(slotted, Path()))
    return max(_verdict(scenario) for scenario in scenarios)


def _verdict(scenario: Scenario) -> str:
    shot = render_scene(scenario, starting_state(scenario))
    with as_file(files("shared.parts") / "catalogue") as catalogue, tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.png"
        cv2.imwrite(str(image), shot.pixels)
        names = (scenario.sources.ring.name, scenario.sources.guide.name, scenario.sources.nail.name)
        ring, guide, nail = (catalogue / f"{name}.json" for name in names)
        return locate_image(image, read_parts(ring, guide, nail)).message.verdict


if __name__ == "__main__":
    sys.exit(0 if compile_kernels() == "accepted" else "the installation's own test image was not accepted")
