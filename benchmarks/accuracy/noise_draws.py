"""One scene under many draws of noise: how much of the nail's tilt is scatter, how much stays, and what was predicted.

Every second draw is the one before with its sign changed, so that what stays is hardly covered by what scatters.
Guide and calibration are estimated from every picture too; the nail is compared in the ring's frame, where the camera's
choice cancels. Beside each scene stands the Cramér-Rao limit, which counts what is the same in all draws (texture,
chamfers) as unknown.

usage: python -m benchmarks.accuracy.noise_draws [--count 7] [--draws 8] [--report docs/benchmarks/noise-draws.md]
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.baselines.methods import run_model
from benchmarks.common.places import PAGES
from benchmarks.common.statistics import root_mean_square
from benchmarks.limits.cramer_rao import limits_of
from benchmarks.limits.cramer_rao_images import scene_images
from benchmarks.scenes.random_scenes import nominal_of, parts_of, scene_of_seed
from distalock.arguments import OneLineParser, whole_number, writable_file
from shared.geometry.frames import Nail, Ring
from shared.geometry.transform import Transform
from simulation.render.image import ImageFaults, Noise, Shot, exposed, view_of
from simulation.world.poses import starting_state

FIRST_SEED = 6000
REPORT = PAGES / "noise-draws.md"
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SceneDraws:
    """Tilt of the nail about its x and y axes over the draws, in degrees.

    Attributes: `errors` shape (K, 2) and `predicted` their standard deviations, of accepted draws; `limit_deg` of both
    axes together.
    """

    seed: int
    material: str
    draws: int
    errors: Floats
    predicted: Floats
    limit_deg: float

    @property
    def scatter_deg(self) -> Floats:
        """Standard deviation over the draws, shape (2,)."""
        return np.asarray(self.errors.std(axis=0, ddof=1))

    @property
    def bias_deg(self) -> Floats:
        """What stays, shape (2,)."""
        return np.asarray(self.errors.mean(axis=0))


def draws_of(seed: int, draws: int) -> SceneDraws:
    """Localise in several exposures of one scene from the same place."""
    scenario = scene_of_seed(seed)
    view, nail = view_of(scenario, starting_state(scenario)), scenario.parts.nail
    errors, predicted = [], []
    for number in range(draws):
        noise = Noise.OPPOSITE if number % 2 else Noise.REAL
        shot = exposed(scenario, view, number // 2 + 1, noise, ImageFaults())
        run = run_model(shot.pixels.astype(np.float32), nominal_of(scenario), parts_of(scenario), shot.truth.holes)
        if run.calibration is None or run.result is None or run.result.nail is None or not run.outcome.accepted:
            continue
        found = run.calibration.camera_from_ring.inverse() @ run.result.nail.camera_from_nail
        errors.append(np.degrees((_ring_from_nail(shot).inverse() @ found).rotation_vector_rad[:2]))
        assert run.result.nail.covariance is not None
        predicted.append(np.degrees(np.sqrt(np.diag(run.result.nail.covariance)[:2])))
    limit = max(limit.axis_deg for limit in limits_of(scene_images(scenario), nail))
    shape = (len(errors), 2)
    return SceneDraws(seed, nail.material, draws, np.reshape(errors, shape), np.reshape(predicted, shape), float(limit))


def _ring_from_nail(shot: Shot) -> Transform[Ring, Nail]:
    assert shot.truth.camera_from_nail is not None
    return shot.truth.camera_from_ring.inverse() @ shot.truth.camera_from_nail


def report(scenes: Sequence[SceneDraws]) -> str:
    """One line per scene, and the whole, as Markdown."""
    lines = [
        "# What noise does to the nail's tilt, and what stays",
        "",
        f"Made by `distalock bench noise_draws`: {len(scenes)} random scenes, {scenes[0].draws} draws of noise each,",
        "every second the opposite of the one before.",
        "Degrees about the nail's x and y axes; the limit (texture and chamfers unknown) is that of both together.",
        "",
        "| scene | accepted | scatter | predicted | what stays | limit |",
        "|---|---|---|---|---|---|",
        *map(_line, scenes),
    ]
    ratio = root_mean_square(np.concatenate([s.scatter_deg / _rms(s.predicted) for s in scenes]))
    total = root_mean_square([float(np.linalg.norm(_rms(s.errors))) / s.limit_deg for s in scenes])
    by_noise = root_mean_square([float(np.linalg.norm(s.scatter_deg)) / s.limit_deg for s in scenes])
    stays = root_mean_square([float(np.linalg.norm(s.bias_deg)) / s.limit_deg for s in scenes])
    summary = f"Scatter over predicted, rms: {ratio:.2f}. Over the limit, rms: "
    summary += f"scatter {by_noise:.2f}, what stays {stays:.2f}, the whole error {total:.2f}."
    lines += [
        "",
        summary,
        "",
    ]
    return "\n".join(lines)


def _line(scene: SceneDraws) -> str:
    columns = (scene.scatter_deg, _rms(scene.predicted))
    pairs = " | ".join(f"{x:.3f}, {y:.3f}" for x, y in columns)
    x, y = scene.bias_deg
    accepted = f"{len(scene.errors)} of {scene.draws}"
    return f"| {scene.seed}, {scene.material} | {accepted} | {pairs} | {x:+.3f}, {y:+.3f} | {scene.limit_deg:.3f} |"


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def main(arguments: Sequence[str] = ()) -> int:
    """Run, print and write the table."""
    parser = OneLineParser(prog="distalock bench noise_draws", description="scenes under many draws of noise")
    count, draws = whole_number("a number of scenes", 1, 10**4), whole_number("a number of draws", 2, 10**4)
    parser.add_argument("--count", type=count, default=7, help="number of scenes (%(default)s)")
    parser.add_argument("--draws", type=draws, default=8, help="exposures of each (%(default)s)")
    parser.add_argument("--report", type=writable_file, default=REPORT, help="file for the table")
    given = parser.parse_args(list(arguments))
    scenes = []
    for seed in range(FIRST_SEED, FIRST_SEED + given.count):
        scenes.append(draws_of(seed, given.draws))
        print(_line(scenes[-1]), flush=True)
    text = report(scenes)
    given.report.write_text(text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
