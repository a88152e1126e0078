"""Random scenes: rendered, localised by every method, compared with the truth."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.capture import Capture, capture_of
from benchmarks.baselines.methods import (
    ModelRun,
    Outcome,
    peer_seconds,
    run_model,
    run_paper,
    run_paper_rule,
)
from benchmarks.common.statistics import root_mean_square
from benchmarks.limits.cramer_rao import AxisLimit, axis_limits
from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from simulation.render.image import Shot, render_scene
from simulation.render.truth import ImageTruth
from simulation.scenario.imaging_values import Intensifier
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

_RIM_REACH = 1.15


@dataclass(frozen=True, slots=True)
class SceneKind:
    """What may make a scene hard.

    Attributes
    ----------
    tilt_deg
        Largest angle between a hole's axis and the ray through it.
    photons_per_px
        Dose.
    balls_on_holes
        Balls of ring and guide whose shadows touch a hole's opening.
    guide_balls_lost
        Share of the guide's balls over metal, under another ball or out of view.
    material, diameter_mm, cannulated, hole_diameter_mm
        Of the nail.
    texture_contrast, spongy_share
        Of the bone.
    distortion_px
        Largest displacement of a ball in view by the detector, its mean taken out; 0 for a flat panel.
    """

    tilt_deg: float
    photons_per_px: float
    balls_on_holes: int
    guide_balls_lost: float
    material: str
    diameter_mm: float
    cannulated: bool
    hole_diameter_mm: float
    texture_contrast: float
    spongy_share: float
    distortion_px: float


@dataclass(frozen=True, slots=True)
class SceneRow:
    """What came out for one scene.

    Attributes
    ----------
    model, paper, paper_rule
        What each method made of it; None where it could not begin, because our own method found no ring or no guide.
    capture
        Where the search for the nail ended before any refusal.
    limits
        Smallest error that any unbiased method can have, hole by hole; None where it was not worked out.
    peer_seconds
        Time of OpenCV's search for circles on the same image, in the same process.
    """

    seed: int
    kind: SceneKind
    model: Outcome
    paper: Outcome | None
    paper_rule: Outcome | None
    capture: Capture
    limits: tuple[AxisLimit, ...] | None
    peer_seconds: float

    @property
    def wrong(self) -> bool:
        """Accepted although an axis is off by more than it may be."""
        return self.model.accepted and (self.model.holes is None or self.model.off)


@dataclass(frozen=True, slots=True)
class AxisErrors:
    """True errors of the worse hole, and both over their predicted standard uncertainty (rms over the holes)."""

    entry_mm: float
    axis_deg: float
    normalised_entry: float
    normalised_axis: float


@dataclass(frozen=True, slots=True)
class SceneResult:
    """What our own method made of one picture: why it was refused (empty when accepted), and its errors."""

    seed: int
    codes: tuple[str, ...]
    model: AxisErrors | None
    wrong: bool


def scene_row(seed: int) -> SceneRow:
    """Render the scene of a seed, and let every method have it."""
    return _row(seed, scene_of_seed(seed), limits=None)


def scene_row_with_limit(seed: int) -> SceneRow:
    """The same, with the smallest possible errors."""
    scenario = scene_of_seed(seed)
    return _row(seed, scenario, axis_limits(scenario))


def model_row(seed: int) -> SceneRow:
    """The same, by our own method alone."""
    scenario = scene_of_seed(seed)
    shot = render_scene(scenario, starting_state(scenario))
    return _model_row(seed, scenario, shot)[0]


def _model_row(seed: int, scenario: Scenario, shot: Shot) -> tuple[SceneRow, ModelRun]:
    pixels, truth = shot.pixels.astype(np.float32), shot.truth
    parts = parts_of(scenario)
    run = run_model(pixels, nominal_of(scenario), parts, truth.holes)
    assert truth.camera_from_nail is not None
    capture = capture_of(pixels, run, parts, truth.camera_from_ring.inverse() @ truth.camera_from_nail)
    return SceneRow(seed, _kind(scenario, shot), run.outcome, None, None, capture, None, peer_seconds(pixels)), run


def _row(seed: int, scenario: Scenario, limits: tuple[AxisLimit, ...] | None) -> SceneRow:
    shot = render_scene(scenario, starting_state(scenario))
    row, run = _model_row(seed, scenario, shot)
    pixels, parts, holes = shot.pixels.astype(np.float32), parts_of(scenario), shot.truth.holes
    return replace(
        row,
        paper=None if run.calibration is None else run_paper(pixels, run.calibration, parts, holes),
        paper_rule=run_paper_rule(pixels, run, parts, holes),
        limits=limits,
    )


def _kind(scenario: Scenario, shot: Shot) -> SceneKind:
    nail, truth = scenario.parts.nail, shot.truth
    guide_balls = [ball for ball in truth.balls if ball.id in set(scenario.parts.guide.balls.ids)]
    lost = [ball for ball in guide_balls if ball.over_metal or ball.touches_ball or not ball.in_view]
    return SceneKind(
        tilt_deg=max(hole.tilt_to_ray_deg for hole in truth.holes),
        photons_per_px=scenario.exposure.photons_per_px,
        balls_on_holes=_balls_on_holes(scenario, truth),
        guide_balls_lost=len(lost) / len(guide_balls),
        material=nail.material,
        diameter_mm=nail.diameter_mm,
        cannulated=nail.cannulation_diameter_mm > 0.0,
        hole_diameter_mm=nail.holes[0].diameter_mm,
        texture_contrast=scenario.anatomy.texture_contrast,
        spongy_share=scenario.anatomy.spongy_share,
        distortion_px=_distortion_px(truth) if isinstance(scenario.detector, Intensifier) else 0.0,
    )


def _balls_on_holes(scenario: Scenario, truth: ImageTruth) -> int:
    """Balls that touch an opening, in undistorted pixels."""
    assert truth.camera_from_nail is not None
    count = 0
    for hole in scenario.parts.nail.holes:
        homogeneous = truth.intrinsic_matrix_px @ (truth.camera_from_nail @ hole.axis.point_mm)
        radius = _RIM_REACH * 0.5 * hole.diameter_mm * truth.intrinsic_matrix_px[0, 0] / homogeneous[2]
        for ball in truth.balls:
            apart = np.hypot(*(np.array(ball.undistorted_px) - homogeneous[:2] / homogeneous[2]))
            count += bool(apart < radius + ball.radius_px)
    return count


def _distortion_px(truth: ImageTruth) -> float:
    seen = [ball for ball in truth.balls if ball.in_view]
    moved = np.array([ball.image_px for ball in seen]) - np.array([ball.undistorted_px for ball in seen])
    return float(np.hypot(*(moved - moved.mean(axis=0)).T).max())


def compared(seed: int, scenario: Scenario, pixels: NDArray[np.float32], truth: ImageTruth) -> SceneResult:
    """Localise in a picture of a scene by our own method."""
    run = run_model(pixels, nominal_of(scenario), parts_of(scenario), truth.holes)
    return SceneResult(seed, run.outcome.codes, _errors(run), run.outcome.accepted and run.outcome.off)


def _errors(run: ModelRun) -> AxisErrors | None:
    """Errors of the worse hole; None when none was found."""
    outcome = run.outcome
    if outcome.entry_mm is None or outcome.axis_deg is None:
        return None
    return AxisErrors(outcome.entry_mm, outcome.axis_deg, *normalised([outcome]))


def normalised(outcomes: Iterable[Outcome]) -> tuple[float, float]:
    """Errors of all holes over what was predicted, rms: entry, axis."""
    holes = [hole for outcome in outcomes for hole in outcome.holes or ()]
    entry = [h.entry_mm / h.entry_sd_mm for h in holes if h.entry_sd_mm]
    axis = [h.axis_deg / h.axis_sd_deg for h in holes if h.axis_sd_deg]
    return root_mean_square(entry), root_mean_square(axis)
