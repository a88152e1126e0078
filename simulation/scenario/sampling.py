"""From a scenario file to the scenario: every quantity picked from its range by the seed.

Each section has its own generator, so that a change in one does not move the others.
"""

from pathlib import Path

import numpy as np

from simulation.scenario.anatomy_sampling import sample_anatomy
from simulation.scenario.files import Ranges, ScenarioFile, merged_ranges, scenario_file_of_seed
from simulation.scenario.imaging_sampling import (
    sample_c_arm_body,
    sample_detector,
    sample_display,
    sample_exposure,
    start_angles,
)
from simulation.scenario.parts import choose_parts
from simulation.scenario.placement_sampling import sample_placement
from simulation.scenario.values import Drilling, MountKind, MountYield, Scenario, Side, side_of_drilling


def section_generator(seed: int, section: str) -> np.random.Generator:
    """Generator of one section: the same for the same seed and name."""
    return np.random.default_rng([seed, *section.encode()])


def scenario_of_seed(seed: int) -> Scenario:
    """The scenario that a seed alone makes, with parts of the catalogue."""
    return scenario_from_file(scenario_file_of_seed(seed), Path())


def scenario_from_file(file: ScenarioFile, folder: Path) -> Scenario:
    """Pick everything.

    Parameters
    ----------
    folder
        Where relative paths of part files start.

    Raises
    ------
    ScenarioInvalid
        When a part cannot be read, or no placement within the ranges can be corrected by the robot.
    """
    ranges = merged_ranges(file.ranges, file.bone)
    case = section_generator(file.seed, "case")
    side, mount = _side(file, case), _mount(file, ranges, case)
    drilled_from = side_of_drilling(file.bone, side)
    extension = _head_extension(file, ranges, case)
    parts, sources = choose_parts(file, folder, section_generator(file.seed, "parts"))
    placed = section_generator(file.seed, "placement")
    placement = sample_placement(ranges.placement, parts, drilled_from, extension, placed)
    body = sample_c_arm_body(ranges.c_arm, section_generator(file.seed, "c_arm"))
    drilling = ranges.drilling
    share = drilling.nail_head_stiffness_share if mount is MountKind.NAIL_HEAD else 1.0
    return Scenario(
        seed=file.seed,
        side=side,
        mount=mount,
        head_extension_mm=extension,
        parts=parts,
        sources=sources,
        anatomy=sample_anatomy(ranges.anatomy, drilled_from, section_generator(file.seed, "anatomy")),
        placement=placement,
        c_arm=start_angles(ranges.placement, body, placement, section_generator(file.seed, "tilt")),
        detector=sample_detector(ranges, body, section_generator(file.seed, "detector")),
        exposure=sample_exposure(ranges.exposure, section_generator(file.seed, "exposure")),
        display=sample_display(ranges.display, section_generator(file.seed, "display")),
        drilling=Drilling(drilling.drill_diameter_mm, drilling.drill_force_n, share),
        mount_yield=None if file.mount_yield is None else MountYield(**file.mount_yield.model_dump()),
        bone=file.bone,
    )


def _side(file: ScenarioFile, generator: np.random.Generator) -> Side:
    picked = Side.LEFT if generator.random() < 0.5 else Side.RIGHT
    return file.side or picked


def _mount(file: ScenarioFile, ranges: Ranges, generator: np.random.Generator) -> MountKind:
    nail_head = generator.random() < ranges.placement.nail_head_mount_probability
    return file.mount or (MountKind.NAIL_HEAD if nail_head else MountKind.BONE)


def _head_extension(file: ScenarioFile, ranges: Ranges, generator: np.random.Generator) -> float:
    """Whole millimetres: what a person reads off the head's scale."""
    picked = float(np.round(generator.uniform(*ranges.head_extension_mm)))
    return picked if file.head_extension_mm is None else file.head_extension_mm
