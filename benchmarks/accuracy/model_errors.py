"""Standard deviations of the nail model's own errors, estimated on scenes that judge nothing.

usage: distalock bench model_errors [--seed 50000] [--count 120] [--minutes 10]

Each seeded scene is rendered and localised. The error of `guide_from_nail`, whose truth is known, has the predicted
covariance of the image (noise, background, guide, calibration, unknown chamfers) and that of the model's own errors.
Maximum likelihood over all scenes gives the latter's standard deviations; their 95 % intervals are those of the profile
likelihood. No test, benchmark or baseline uses these seeds.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize, minimize_scalar

from benchmarks.scenes.set_ups import SetUp
from services.registration.core.estimation.pose_estimate import POSE_SIZE, model_loadings
from services.registration.core.guide_from_nail import guide_from_nail_of
from services.registration.core.tuning import MODEL_ERRORS
from shared.arguments import OneLineParser

FIRST_SEED, SCENES, PROCESSES, MINUTES = 50_000, 120, 2, 10.0
_POSE_NAMES = ("tilt_deg", "turn_about_z_deg", "position_mm")
_SHAPE_NAME = "radius_deviations"
# Deviations of hole radius and nail radius; chamfers, the third, have no model error of their own.
_RADII = slice(POSE_SIZE, POSE_SIZE + 2)
# Half the 95 % quantile of chi-square with one degree of freedom: by so much the log-likelihood falls at the interval.
_HALF_CHI_SQUARE = 1.92
_LEAST_SHARE, _LARGEST_SHARE = 1e-3, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class SceneErrors:
    """Errors of one scene: of the pose, shape (6,), and of the radii in deviations, shape (2,).

    Attributes
    ----------
    pose_covariance, radius_covariance
        Predicted without the model's own errors, shapes (6, 6) and (2, 2).
    unit_loadings
        The model's own errors where each standard deviation is the one in use, one per column, shape (6, 6).
    """

    seed: int
    pose_error: NDArray[np.float64]
    pose_covariance: NDArray[np.float64]
    unit_loadings: NDArray[np.float64]
    radius_error: NDArray[np.float64]
    radius_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One standard deviation with its 95 % interval, beside the one in use."""

    name: str
    value: float
    lowest: float
    highest: float
    in_use: float


def main(arguments: Sequence[str] = ()) -> int:
    """Localise the scenes, print estimates and intervals; 0 when every value in use lies in its interval."""
    given = _options(arguments)
    scenes = errors_of_scenes(range(given.seed, given.seed + given.count), given.minutes)
    estimates = (*estimates_of_pose(scenes), estimate_of_radii(scenes))
    print(report(scenes, estimates))
    return int(any(not one.lowest <= one.in_use <= one.highest for one in estimates))


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench model_errors", description="fit the model's own errors")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--count", type=int, default=SCENES)
    parser.add_argument("--minutes", type=float, default=MINUTES, help="after which no further scene is begun")
    return parser.parse_args(list(arguments))


def errors_of_scenes(seeds: Sequence[int], minutes: float) -> list[SceneErrors]:
    """Accepted scenes among the seeds, as many as the time allows."""
    end = time.monotonic() + 60.0 * minutes
    with ProcessPoolExecutor(PROCESSES) as pool:
        jobs = [pool.submit(errors_of_scene, seed, end) for seed in seeds]
        found = [one for job in as_completed(jobs) if (one := job.result()) is not None]
    return sorted(found, key=lambda one: one.seed)


def errors_of_scene(seed: int, end: float) -> SceneErrors | None:
    """Render, localise and compare one scene; None when it is rejected, or begun after the end (`time.monotonic`)."""
    if time.monotonic() > end:
        return None
    set_up = SetUp.of_seed(seed)
    image = set_up.seen(0)
    result, parts = image.result, set_up.parts
    if image.reasons or image.calibration is None or result is None or result.guide is None or result.nail is None:
        return None
    estimate = guide_from_nail_of(image.calibration, parts.guide, parts.nail, result.guide, result.nail)
    if estimate is None:
        return None
    errors = estimate.errors
    # the scenes' radii are those of their files; chamfers are not in the files
    by_chamfer = errors.shape_pull[:, 2:]
    covariance = errors.image_covariance + by_chamfer @ by_chamfer.T
    print(f"{seed}: localised", flush=True)
    return SceneErrors(
        seed=seed,
        pose_error=estimate.mean.motion_to(image.shot.world.guide_from_nail),
        pose_covariance=covariance[:POSE_SIZE, :POSE_SIZE],
        unit_loadings=model_loadings(parts.nail, result.nail.camera_from_nail),
        radius_error=-errors.shape_deviations[:2],
        radius_covariance=covariance[_RADII, _RADII],
    )


def estimates_of_pose(scenes: Sequence[SceneErrors]) -> tuple[Estimate, ...]:
    """Standard deviations of tilt, turn and position, as shares of the ones in use, by maximum likelihood."""

    def loss(log_shares: NDArray[np.float64]) -> float:
        tilt, turn, position = np.exp(2.0 * log_shares)
        shares = np.array([tilt, tilt, turn, position, position, position])
        return sum(
            _loss(one.pose_error, one.pose_covariance + (one.unit_loadings * shares) @ one.unit_loadings.T)
            for one in scenes
        )

    start = np.zeros(len(_POSE_NAMES))
    best = minimize(loss, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4, "maxiter": 2000})

    def profile(k: int, log_share: float) -> float:
        def others(free: NDArray[np.float64]) -> float:
            return loss(np.insert(free, k, log_share))

        found = minimize(others, np.delete(best.x, k), method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-3})
        return float(found.fun)

    estimates = []
    for k, name in enumerate(_POSE_NAMES):
        low, high = _interval(partial(profile, k), float(best.x[k]), float(best.fun))
        in_use = getattr(MODEL_ERRORS, name)
        estimates.append(Estimate(name, in_use * float(np.exp(best.x[k])), in_use * low, in_use * high, in_use))
    return tuple(estimates)


def estimate_of_radii(scenes: Sequence[SceneErrors]) -> Estimate:
    """Standard deviation of the radii's model error, by maximum likelihood."""
    in_use = MODEL_ERRORS.radius_deviations

    def loss(log_share: float) -> float:
        variance = (in_use * np.exp(log_share)) ** 2 * np.eye(2)
        return sum(_loss(one.radius_error, one.radius_covariance + variance) for one in scenes)

    bounds = (float(np.log(_LEAST_SHARE)), float(np.log(_LARGEST_SHARE)))
    best = minimize_scalar(loss, bounds=bounds, method="bounded")
    low, high = _interval(loss, float(best.x), float(best.fun))
    return Estimate(_SHAPE_NAME, in_use * float(np.exp(best.x)), in_use * low, in_use * high, in_use)


def report(scenes: Sequence[SceneErrors], estimates: Sequence[Estimate]) -> str:
    """The table."""
    seeds = f"{scenes[0].seed} to {scenes[-1].seed}" if scenes else "none"
    head = f"{'value':20} {'estimate':>9} {'95 % interval':>20} {'in use':>7}"
    lines = [f"{len(scenes)} accepted scenes, seeds {seeds}", head]
    lines += [f"{e.name:20} {e.value:9.4f} {e.lowest:9.4f} - {e.highest:8.4f} {e.in_use:7.3f}" for e in estimates]
    return "\n".join(lines)


def _loss(error: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Negative log-likelihood of a normal error, without its constant."""
    return 0.5 * float(error @ np.linalg.solve(covariance, error) + np.linalg.slogdet(covariance)[1])


def _interval(loss: Callable[[float], float], best: float, least: float) -> tuple[float, float]:
    """Ends of the 95 % interval of the profile likelihood, as shares; 0 or the largest share if it has no end."""

    def excess(log_share: float) -> float:
        return loss(log_share) - least - _HALF_CHI_SQUARE

    lowest, highest = float(np.log(_LEAST_SHARE)), float(np.log(_LARGEST_SHARE))
    low = float(np.exp(brentq(excess, lowest, best, xtol=1e-2))) if excess(lowest) > 0.0 else 0.0
    high = float(np.exp(brentq(excess, best, highest, xtol=1e-2))) if excess(highest) > 0.0 else _LARGEST_SHARE
    return low, high


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
