"""`python -m distalock.prepare`: compile the numerical kernels after installing, so that no first image is a slow one.

The compiler keeps its results beside the sources. Rendering one scene of the virtual room and localising it calls every
kernel with the types that it will be called with later.
"""

import sys
import tempfile
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import cv2

from distalock.locate import locate_image, read_parts
from simulation.render.image import render_scene
from simulation.scenario.sampling import scenario_of_seed
from simulation.world.poses import starting_state

SEED: Final = 2


def compile_kernels() -> str:
    """Render and localise one scene; the verdict, as a sign that the installation works."""
    scenario = scenario_of_seed(SEED)
    shot = render_scene(scenario, starting_state(scenario))
    with as_file(files("shared.parts") / "catalogue") as catalogue, tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.png"
        cv2.imwrite(str(image), shot.pixels)
        names = (scenario.sources.ring.name, scenario.sources.guide.name, scenario.sources.nail.name)
        ring, guide, nail = (catalogue / f"{name}.json" for name in names)
        return locate_image(image, read_parts(ring, guide, nail)).message.verdict


if __name__ == "__main__":
    sys.exit(0 if compile_kernels() == "accepted" else "the installation's own test image was not accepted")
