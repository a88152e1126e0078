"""Seeded X-ray scenes with random parts: rendered, localised by both methods, compared with the truth.

Every scene has its own ring and guide pattern and its own nail, so that nothing can be tuned to them.
"""

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from benchmarks.varied_parts import write_parts
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.localise import LocalisationResult, Method, Parts, localise
from shared.errors import Reason, Rejected
from shared.geometry.lines import Line, angle_between_rad
from simulation.render.image import render_scene
from simulation.scenario.files import ScenarioFile
from simulation.scenario.sampling import scenario_from_file
from simulation.scenario.values import Scenario
from simulation.truth import HoleTruth, ImageTruth
from simulation.world import starting_state

LARGEST_ENTRY_ERROR_MM, LARGEST_AXIS_ERROR_DEG = 1.0, 1.5
# Tilts up to the ten degrees at which a good image must still be accepted; more doses and displays than a case has.
RANGES: dict[str, JsonValue] = {
    "placement": {"start_tilt_deg": [0.3, 10.0]},
    "c_arm": {"source_to_detector_mm": [900.0, 1050.0], "nail_to_detector_mm": [200.0, 300.0]},
    "exposure": {"photons_per_px": [200.0, 1400.0]},
    "display": {"mirrored_probability": 0.4, "eight_bits_probability": 0.3},
}


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """True errors of the worse hole, and both over their predicted standard uncertainty (rms over the holes)."""

    entry_mm: float
    axis_deg: float
    normalised_entry: float
    normalised_axis: float


@dataclass(frozen=True, slots=True)
class SceneResult:
    """What came out for one scene.

    Attributes
    ----------
    tilt_deg
        Largest angle between a hole's axis and the ray through it.
    codes
        Why it was refused; empty when accepted.
    model, fronto_parallel
        Errors of the axes that each method found; None where it found none.
    """

    seed: int
    nail: str
    tilt_deg: float
    codes: tuple[str, ...]
    model: AxisErrors | None
    fronto_parallel: AxisErrors | None

    @property
    def accepted(self) -> bool:
        """Whether a robot would be moved by it."""
        return not self.codes

    @property
    def wrong(self) -> bool:
        """Accepted although an axis is off by more than it may be."""
        return self.accepted and (self.model is None or _too_far_off(self.model))


def scene_of_seed(seed: int) -> Scenario:
    """A scenario with random ring, guide and nail, and the ranges of this benchmark."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = write_parts(folder, np.random.default_rng([seed, *b"varied parts"]))
        file = ScenarioFile.model_validate({"schema": "distalock/scenario/1", "seed": seed, "ranges": RANGES, **parts})
        return scenario_from_file(file, folder)


def localised_scene(seed: int) -> SceneResult:
    """Render the scene of a seed, localise by both methods and compare with the truth."""
    scenario = scene_of_seed(seed)
    shot = render_scene(scenario, starting_state(scenario))
    return compared(seed, scenario, shot.pixels.astype(np.float32), shot.truth)


def compared(seed: int, scenario: Scenario, pixels: NDArray[np.float32], truth: ImageTruth) -> SceneResult:
    """Localise in an image of a scene by both methods."""
    nail = scenario.parts.nail
    name = f"{nail.material} {nail.diameter_mm:g}/{nail.cannulation_diameter_mm:g}, {nail.holes[0].diameter_mm:g} mm"
    tilt = max(hole.tilt_to_ray_deg for hole in truth.holes)
    c_arm = scenario.c_arm
    nominal = NominalGeometry(c_arm.nominal_source_to_detector_mm, c_arm.nominal_pixel_mm)
    calibrated = calibrate_image(pixels, scenario.parts.ring, nominal)
    if isinstance(calibrated, Rejected):
        return SceneResult(seed, name, tilt, _codes(calibrated.reasons), None, None)
    parts = Parts(scenario.parts.ring, scenario.parts.guide, nail)
    model, paper = (
        localise(pixels, calibrated.value, parts, method, lambda _: None)
        for method in (Method.MODEL, Method.FRONTO_PARALLEL)
    )
    truths = truth.holes
    return SceneResult(seed, name, tilt, _codes(model.reasons), _errors(model, truths), _errors(paper, truths))


def _codes(reasons: Iterable[Reason]) -> tuple[str, ...]:
    return tuple(reason.code.value for reason in reasons)


def _errors(result: LocalisationResult, truths: Sequence[HoleTruth]) -> AxisErrors | None:
    """Errors of the worse hole; None when the method found none."""
    if result.holes is None:
        return None
    found = {hole.id: hole for hole in result.holes}
    errors = np.array([_hole_errors(found[truth.id], truth) for truth in truths])
    entry_mm, axis_deg = errors[:, :2].max(axis=0)
    return AxisErrors(float(entry_mm), float(axis_deg), root_mean_square(errors[:, 2]), root_mean_square(errors[:, 3]))


def _hole_errors(hole: HoleEstimate, truth: HoleTruth) -> tuple[float, float, float, float]:
    """Entry (mm), axis (degrees), and both over their predicted standard uncertainty (NaN where none is predicted)."""
    entry_mm = Line(truth.entry_point_guide_mm, truth.axis_guide).distance_mm(hole.entry_guide_mm)
    axis_deg = float(np.degrees(angle_between_rad(truth.axis_guide, hole.axis_guide.direction)))
    if hole.offset is None:
        return entry_mm, axis_deg, np.nan, np.nan
    return entry_mm, axis_deg, entry_mm / hole.offset.entry_sd_mm, axis_deg / hole.offset.axis_sd_deg


def _too_far_off(errors: AxisErrors) -> bool:
    return not (errors.entry_mm <= LARGEST_ENTRY_ERROR_MM and errors.axis_deg <= LARGEST_AXIS_ERROR_DEG)


def root_mean_square(values: Iterable[float]) -> float:
    """Of any number of values; NaN of none."""
    array = np.array(list(values))
    return float(np.sqrt(np.mean(array**2))) if len(array) else float("nan")
