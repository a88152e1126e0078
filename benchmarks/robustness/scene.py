"""One image of a kind with its truth, made from a seed; and the folder that keeps rendered images."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes.changed_parts import with_holes
from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.localise import Parts
from shared.geometry.lines import Line
from shared.geometry.parts import Hole
from simulation.render.display import Grey, turned_points
from simulation.render.image import NO_FAULTS, ChangePacked, ImageFaults, Noise, Shot, exposed, view_of
from simulation.render.retracing import Retracing
from simulation.render.truth import HoleTruth
from simulation.scenario.values import Scenario
from simulation.world.poses import WorldState, starting_state

Drawn: TypeAlias = dict[str, int | float | str]
Floats = NDArray[np.float64]
# Beginning of the name, among the drawn parameters, of the share that an object covers of a hole.
COVERED = "covered_"
# By how much a hole's place or length differs from what the part file says, among the drawn parameters.
BESIDE_FILE_MM = "beside_file_mm"


@dataclass(frozen=True, slots=True, eq=False)
class RobustScene:
    """An image of a kind, and what is true in it.

    Attributes
    ----------
    drawn
        The kind's parameters, drawn from the seed.
    pixels
        Grey values, shape (rows, columns), 8 or 16 bits.
    holes
        Truth hole by hole: each has its own axis, in the guide's frame, where the guide's frame is that of its file.
    middle_px
        Column and row of the nail's origin in the image, distortion left out: where to look.
    filed_holes
        The nail's holes in the file that a localisation gets; None where they are those of the seed's scene.
    """

    kind: str
    seed: int
    drawn: Drawn
    pixels: Grey
    nominal: NominalGeometry
    holes: tuple[HoleTruth, ...]
    middle_px: tuple[float, float]
    filed_holes: tuple[Hole, ...] | None = None

    @property
    def parts(self) -> Parts:
        """The part files that a localisation gets: nominal ones, which do not state how holes are chamfered."""
        scenario = scene_of_seed(self.seed)
        return parts_of(scenario if self.filed_holes is None else with_holes(scenario, self.filed_holes))


def generator_of(kind: str, seed: int) -> np.random.Generator:
    """The draws of one kind in one scene."""
    return np.random.default_rng([seed, *kind.encode()])


def scene_of_shot(kind: str, scenario: Scenario, shot: Shot, drawn: Drawn, holes: tuple[HoleTruth, ...]) -> RobustScene:
    """A rendered shot as a scene of a kind."""
    size = scenario.c_arm.size_px
    origin = shot.world.intrinsic_matrix_px @ shot.world.beam_from_nail.translation_mm
    column, row = turned_points(scenario.display, origin[:2] / origin[2], size)
    middle = (float(size - 1 - column if scenario.display.mirrored else column), float(row))
    return RobustScene(kind, scenario.seed, drawn, shot.pixels, nominal_of(scenario), holes, middle)


def rendered(
    scenario: Scenario,
    state: WorldState,
    change: ChangePacked = lambda packed, _: packed,
    shot_number: int = 0,
    faults: ImageFaults = NO_FAULTS,
    retracing: Retracing | None = None,
) -> Shot:
    """A shot, as `render_scene`, of a world whose packed shapes were changed."""
    return exposed(scenario, view_of(scenario, state, retracing, change), shot_number, Noise.REAL, faults)


def plain_scene(kind: str, seed: int) -> RobustScene:
    """The scene of a seed as it is: the control of every kind."""
    scenario = scene_of_seed(seed)
    shot = rendered(scenario, starting_state(scenario))
    return scene_of_shot(kind, scenario, shot, {}, shot.truth.holes)


@dataclass(frozen=True, slots=True)
class ImageFolder:
    """Rendered images on file: `<folder>/<kind>/<seed>.png` with truth in a JSON file beside it; None keeps none.

    An image on file is taken as it is: delete the folder of a kind whose code changed.
    """

    folder: Path | None

    def scene(self, kind: str, seed: int, make: Callable[[str, int], RobustScene]) -> RobustScene:
        """The scene on file, or made now and kept."""
        if self.folder is None:
            return make(kind, seed)
        image = self.folder / kind / f"{seed}.png"
        if not image.with_suffix(".json").exists():
            _write(image, make(kind, seed))
        return _read(image, kind, seed)


def _write(image: Path, scene: RobustScene) -> None:
    """The JSON file last: an image without it was cut off; several runs may share a folder."""
    image.parent.mkdir(parents=True, exist_ok=True)
    unfinished = image.with_name(f"{image.stem}-{os.getpid()}.png")
    cv2.imwrite(str(unfinished), scene.pixels)
    unfinished.replace(image)
    nominal = {"source_to_detector_mm": scene.nominal.source_to_detector_mm, "pixel_mm": scene.nominal.pixel_mm}
    holes = [
        {
            "id": hole.id,
            "entry_mm": hole.entry_point_guide_mm.tolist(),
            "axis": hole.axis_guide.tolist(),
            "tilt_to_ray_deg": hole.tilt_to_ray_deg,
        }
        for hole in scene.holes
    ]
    content = {"drawn": scene.drawn, "nominal": nominal, "holes": holes, "middle_px": scene.middle_px}
    if scene.filed_holes is not None:
        content["filed_holes"] = [_filed(hole) for hole in scene.filed_holes]
    unfinished = unfinished.with_suffix(".json")
    unfinished.write_text(json.dumps(content, indent=1))
    unfinished.replace(image.with_suffix(".json"))


def _read(image: Path, kind: str, seed: int) -> RobustScene:
    content = json.loads(image.with_suffix(".json").read_text())
    pixels = np.asarray(cv2.imread(str(image), cv2.IMREAD_UNCHANGED))
    holes = tuple(
        HoleTruth(hole["id"], np.array(hole["entry_mm"]), np.array(hole["axis"]), hole["tilt_to_ray_deg"])
        for hole in content["holes"]
    )
    column, row = content["middle_px"]
    nominal, filed = NominalGeometry(**content["nominal"]), None
    if "filed_holes" in content:
        filed = tuple(
            Hole(h["id"], Line(np.array(h["point_mm"]), np.array(h["direction"])), h["diameter_mm"], None, h["slot_mm"])
            for h in content["filed_holes"]
        )
    return RobustScene(kind, seed, content["drawn"], pixels, nominal, holes, (column, row), filed)


def _filed(hole: Hole) -> dict[str, object]:
    return {
        "id": hole.id,
        "point_mm": hole.axis.point_mm.tolist(),
        "direction": hole.axis.direction.tolist(),
        "diameter_mm": hole.diameter_mm,
        "slot_mm": hole.slot_length_mm,
    }
