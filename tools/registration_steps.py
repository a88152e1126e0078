"""Draw `docs/images/registration-steps.png`: what each of the twelve steps from pixels to hole axes makes of one image.

usage: python -m tools.registration_steps [--seed 2] [--out FILE]
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.registration.core.guide.locate import GuideFit, locate_guide
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.localise import Parts, distal_direction, known_balls, localise, unmirrored
from services.registration.core.nail.covariance import nail_pose_covariance
from services.registration.core.nail.forward_model import model_at
from services.registration.core.nail.least_squares import (
    LinearSolution,
    estimate_noise,
    linear_solution_at,
    minimise_from,
    problem_for,
    whitened,
    with_derivatives,
)
from services.registration.core.nail.parameters import STRAIGHT_NAIL
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.search.band import depth_range_mm, find_bands, prepare_search
from services.registration.core.nail.search.find import NailDetection, find_nail
from services.registration.core.nail.tilt_ambiguity import GlobalOptimum, find_global_optimum
from services.registration.core.tuning import FINAL_STAGE
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from simulation.render.image import render_scene
from simulation.scenario.sampling import scenario_of_seed
from simulation.world.poses import starting_state

OUT = Path(__file__).parents[1] / "docs" / "images" / "registration-steps.png"
_RING, _GUIDE, _NAIL = "tab:orange", "tab:green", "tab:cyan"
_MARGIN_PX = 70.0
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """One image with what each step found in it."""

    pixels: NDArray[np.float32]
    parts: Parts
    calibration: CArmCalibration
    guide: GuideFit
    detection: NailDetection
    optimum: GlobalOptimum
    last: LinearSolution
    covariance: NDArray[np.float64]
    holes: tuple[HoleEstimate, ...]


def main(arguments: Sequence[str] | None = None) -> int:
    """Localise one rendered image step by step and draw the steps."""
    parser = argparse.ArgumentParser(prog="python -m tools.registration_steps", description="draw the steps")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args(arguments)
    mpl.use("Agg")
    figure, axes = plt.subplots(3, 4, figsize=(16.0, 12.4), layout="constrained")
    draw(steps_of(given.seed), list(axes.flat))
    figure.savefig(given.out, dpi=75)
    return 0


def steps_of(seed: int) -> Steps:
    """Render the scene of a seed and keep what each step finds."""
    scenario = scenario_of_seed(seed)
    received = render_scene(scenario, starting_state(scenario)).pixels.astype(np.float32)
    c_arm = scenario.c_arm
    parts = Parts(scenario.parts.ring, scenario.parts.guide, scenario.parts.nail, USUAL_DRILL_DIAMETER_MM)
    nominal = NominalGeometry(c_arm.nominal_source_to_detector_mm, c_arm.nominal_pixel_mm)
    calibration = _accepted(calibrate_image(received, parts.ring, nominal))
    pixels = unmirrored(received, calibration)
    guide = _accepted(locate_guide(pixels, calibration, parts.ring, parts.guide))
    detection = _accepted(find_nail(pixels, calibration, parts.nail, distal_direction(guide)))
    fit_input = FitInput(pixels, calibration, parts.nail, known_balls(parts, guide))
    optimum = find_global_optimum(fit_input, detection.camera_from_nail)
    assert optimum is not None
    last, covariance = _last_stage(fit_input, optimum)
    holes = localise(received, calibration, parts).holes
    assert holes is not None
    return Steps(pixels, parts, calibration, guide, detection, optimum, last, covariance, holes)


def _accepted(outcome: Accepted[T] | Rejected) -> T:
    assert isinstance(outcome, Accepted), outcome
    return outcome.value


def _last_stage(fit_input: FitInput, optimum: GlobalOptimum) -> tuple[LinearSolution, NDArray[np.float64]]:
    """The fit at full resolution, and the covariance of its pose."""
    model = model_at(fit_input, optimum.camera_from_nail, FINAL_STAGE, 1)
    assert model is not None
    problem = problem_for(model, FINAL_STAGE, STRAIGHT_NAIL)
    problem, here = whitened(problem, linear_solution_at(problem, optimum.parameters))
    solution = with_derivatives(problem, minimise_from(problem, here, FINAL_STAGE.first_steps, FINAL_STAGE.tolerance))
    return solution.linear, nail_pose_covariance(problem, solution, estimate_noise(problem, solution.linear))


def draw(steps: Steps, axes: list[Axes]) -> None:
    """All twelve panels."""
    panels = (
        _discs,
        _ring_identity,
        _distortion,
        _source,
        _guide_identity,
        _guide_pose,
        _band,
        _initial_pose,
        _region,
        _optima,
        _residual,
        _hole_axes,
    )
    for number, (panel, axis) in enumerate(zip(panels, axes, strict=True), start=1):
        axis.set_title(f"{number}  {panel(steps, axis)}", loc="left", fontsize=12)


def _image(steps: Steps, axis: Axes, window: tuple[float, float, float, float] | None = None) -> None:
    low, high = np.percentile(steps.pixels, [1.0, 99.5])
    axis.imshow(steps.pixels, cmap="gray", vmin=low, vmax=high)
    axis.set_xticks([])
    axis.set_yticks([])
    if window is not None:
        axis.set_xlim(window[0], window[1])
        axis.set_ylim(window[3], window[2])


def _around(px: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Window about points, shape (N, 2)."""
    low, high = px.min(axis=0) - _MARGIN_PX, px.max(axis=0) + _MARGIN_PX
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _hole_centres_px(steps: Steps) -> NDArray[np.float64]:
    middles = np.array([hole.axis.point_mm for hole in steps.parts.nail.holes])
    return steps.calibration.image_from_camera(steps.optimum.camera_from_nail.points(middles))


def _discs(steps: Steps, axis: Axes) -> str:
    _image(steps, axis)
    balls = steps.calibration.balls
    for centre, radius in zip(balls.centre_px, balls.radius_px, strict=True):
        axis.add_patch(Circle((centre[0], centre[1]), radius + 3.0, fill=False, color=_RING, lw=0.8))
    return f"dark discs: {len(balls.centre_px)}"


def _ring_identity(steps: Steps, axis: Axes) -> str:
    _image(steps, axis)
    balls, plate = steps.calibration.balls, steps.parts.ring.balls.position_mm[:, 2]
    named = balls.ring_index != NOT_OF_THE_RING
    near = plate[balls.ring_index[named]] > np.mean(plate)
    for which, colour in ((near, _RING), (~near, "tab:red")):
        axis.plot(*balls.centre_px[named][which].T, "o", mfc="none", ms=6, color=colour)
    return f"ring: {steps.calibration.balls_found} of {steps.calibration.balls_expected} balls"


def _distortion(steps: Steps, axis: Axes) -> str:
    calibration = steps.calibration
    x, y = np.meshgrid(np.linspace(40, calibration.width_px - 40, 15), np.linspace(40, calibration.height_px - 40, 15))
    at = np.column_stack([x.ravel(), y.ravel()])
    at = at[calibration.shows(at[:, 0], at[:, 1], 0.0)]
    moved = calibration.distortion.undistort(at) - at
    moved -= moved.mean(axis=0)
    axis.quiver(*at.T, *moved.T, angles="xy", scale_units="xy", scale=0.25, width=0.003, color=_RING)
    axis.set_aspect("equal")
    axis.invert_yaxis()
    axis.set_xticks([])
    axis.set_yticks([])
    return f"distortion x 4 (largest {np.hypot(*moved.T).max():.1f} px)"


def _source(steps: Steps, axis: Axes) -> str:
    calibration = steps.calibration
    source = calibration.camera_from_ring.inverse().translation_mm
    balls = steps.parts.ring.balls.position_mm
    for x, _, z in balls[:: max(1, len(balls) // 24)]:
        axis.plot([source[0], x], [source[2], z], color="0.8", lw=0.6)
    axis.plot(balls[:, 0], balls[:, 2], ".", color=_RING)
    axis.plot(source[0], source[2], "*", ms=14, color="tab:red")
    axis.set_xlabel("ring x, mm")
    axis.set_ylabel("ring z, mm")
    sd = np.sqrt(np.diag(calibration.source_covariance_mm2))
    return f"focal spot ± {sd[0]:.2f}, {sd[1]:.2f}, {sd[2]:.2f} mm"


def _guide_px(steps: Steps) -> NDArray[np.float64]:
    return steps.calibration.distortion.distort(steps.guide.ideal_px)


def _guide_identity(steps: Steps, axis: Axes) -> str:
    px, used = _guide_px(steps), steps.guide.used
    _image(steps, axis, _around(px[used]))
    for name, place in zip(np.array(steps.parts.guide.balls.ids)[used], px[used], strict=True):
        axis.text(place[0] + 6, place[1] - 6, str(name), color=_GUIDE, fontsize=7)
    axis.plot(*px[used].T, "+", color=_GUIDE)
    return f"guide identified (margin {steps.guide.runner_up_margin} balls)"


def _guide_pose(steps: Steps, axis: Axes) -> str:
    used = steps.guide.used
    position = steps.parts.guide.balls.position_mm[used]
    predicted = steps.calibration.camera.project(steps.guide.camera_from_guide.points(position))
    apart = steps.guide.ideal_px[used] - predicted
    sd = steps.guide.standard_deviation_px[used]
    axis.errorbar(apart[:, 0], apart[:, 1], xerr=sd, yerr=sd, fmt="o", ms=3, lw=0.6, color=_GUIDE)
    axis.axhline(0.0, color="0.8", lw=0.6)
    axis.axvline(0.0, color="0.8", lw=0.6)
    axis.set_aspect("equal")
    axis.set_xlabel("residual, px")
    return f"guide: {steps.guide.balls_found} balls, {steps.guide.reprojection_rms_px:.3f} px rms"


def _band(steps: Steps, axis: Axes) -> str:
    search = prepare_search(steps.pixels, steps.calibration, steps.parts.nail)
    near_mm, far_mm = depth_range_mm(steps.calibration)
    width = steps.parts.nail.diameter_mm * steps.calibration.camera.focal_length_px / search.step_px
    axis.imshow(search.grey, cmap="gray")
    for band in find_bands(search, (width / far_mm, width / near_mm), 1):
        for side in (-0.5, 0.5):
            ends = [band.centre_px + side * band.width_px * band.across + t * band.along for t in (-200.0, 200.0)]
            axis.plot(*np.array(ends).T, color=_NAIL, lw=1.2)
    axis.set_xlim(0, search.grey.shape[1])
    axis.set_ylim(search.grey.shape[0], 0)
    axis.set_xticks([])
    axis.set_yticks([])
    return "nail's band on the reduced image"


def _initial_pose(steps: Steps, axis: Axes) -> str:
    _image(steps, axis, _around(_hole_centres_px(steps)))
    for opening in steps.detection.openings:
        axis.plot(*opening.outline_px.T, ".", ms=3, color=_NAIL)
    return "openings, zero tilt"


def _on_rectangle(steps: Steps, values: NDArray[np.float64]) -> NDArray[np.float64]:
    region = steps.last.model.region
    image = np.full(region.shape, np.nan)
    image.ravel()[region.compared] = values
    return image


def _rectangle(axis: Axes, image: NDArray[np.float64], colours: str) -> None:
    axis.imshow(image, cmap=colours)
    axis.set_xticks([])
    axis.set_yticks([])


def _region(steps: Steps, axis: Axes) -> str:
    region = steps.last.model.region
    _rectangle(axis, np.asarray(steps.last.traced.transmission, dtype=np.float64), "gray")
    return f"transmission, {len(region.compared)} px"


def _optima(steps: Steps, axis: Axes) -> str:
    _image(steps, axis, _around(_hole_centres_px(steps)))
    centres, pose = _hole_centres_px(steps), steps.optimum.camera_from_nail
    tilt = pose.rotation[:, 2]
    for centre in centres:
        for sign, colour, style in ((1.0, _NAIL, "-"), (-1.0, "tab:red", "--")):
            end = centre + sign * 600.0 * tilt[:2]
            axis.plot([centre[0], end[0]], [centre[1], end[1]], style, color=colour, lw=1.6)
    return f"tilt, reflection: margin {steps.optimum.margin:.0f}"


def _residual(steps: Steps, axis: Axes) -> str:
    residual = steps.last.residual / np.std(steps.last.residual)
    axis.imshow(_on_rectangle(steps, residual), cmap="RdBu", vmin=-4.0, vmax=4.0)
    axis.set_xticks([])
    axis.set_yticks([])
    sd_deg = np.degrees(np.sqrt(np.trace(steps.covariance[:2, :2])))
    return f"whitened residual; tilt ± {sd_deg:.2f}°"


def _hole_axes(steps: Steps, axis: Axes) -> str:
    for hole in steps.holes:
        assert hole.offset is not None
        values, vectors = np.linalg.eigh(hole.offset.covariance_mm2[:2, :2])
        angle = np.linspace(0.0, 2.0 * np.pi, 60)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        ellipse = vectors @ (2.45 * np.sqrt(values)[:, None] * circle)
        axis.plot(*ellipse, label=f"{hole.id}: ± {hole.offset.entry_sd_mm:.3f} mm, {hole.offset.axis_sd_deg:.2f}°")
    axis.set_aspect("equal")
    axis.set_xlabel("offset at the entry, mm: 95 % bound")
    axis.legend(loc="upper right", fontsize=9)
    return "hole axes in the guide frame"


if __name__ == "__main__":
    sys.exit(main())
