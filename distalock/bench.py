"""`distalock bench`: the statistics, whole. Each benchmark is a module of the `benchmarks` folder of a checkout."""

import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT
from shared.errors import InputError

ROOT: Final = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A module under `benchmarks`, whose `main` writes a page under docs/ and returns an exit code."""

    module: str
    measures: str


BENCHMARKS: Final = {
    "accuracy": Benchmark(
        "accuracy.accuracy",
        "a thousand random scenes with random parts, by the model and by the paper's method, and the limit",
    ),
    "independent_images": Benchmark(
        "accuracy.independent_images", "every method on images that others rendered, where there is a folder of them"
    ),
    "same_results": Benchmark(
        "accuracy.same_results", "verdicts and axes before and after a change, on the same images on file"
    ),
    "cramer_rao": Benchmark(
        "limits.cramer_rao", "the smallest error possible in one random scene, and what it is made of"
    ),
    "noise_draws": Benchmark(
        "accuracy.noise_draws", "scenes under many draws of noise: what is scatter, what stays, what was predicted"
    ),
    "image_time": Benchmark(
        "accuracy.image_time", "how long one image takes, stage by stage, on both cores and on one"
    ),
    "ball_detection": Benchmark(
        "imaging.ball_detection",
        "balls covered in part, beside OpenCV's detectors, correlation and the Cramér-Rao limit",
    ),
    "calibration": Benchmark(
        "imaging.independent_calibration", "C-arm calibration on independent images, where there is a folder of them"
    ),
    "display": Benchmark("accuracy.display", "the same pictures with other curves, edges, bit depths and compression"),
    "guidance": Benchmark(
        "accuracy.guidance",
        "how to turn the C-arm, frame by frame: speed, errors, and what is said when it cannot be told",
    ),
    "fusion": Benchmark(
        "accuracy.fusion",
        "one, two and three images of one set-up: errors, what they share, and guides that moved unseen",
    ),
    "imaging_calibration": Benchmark(
        "imaging.calibration",
        "C-arm calibration from 72 of 120 balls, beside OpenCV's models, polynomials and the limit",
    ),
    "imaging_gap": Benchmark(
        "imaging.calibration_gap",
        "where a calibration's error comes from: what is measured, and what the model leaves over",
    ),
    "imaging_fuzz": Benchmark(
        "imaging.fuzz", "damaged files and spoiled images: refused, or read and calibrated rightly"
    ),
    "imaging_identification": Benchmark(
        "imaging.identification", "the ring from 60 % of its balls, a thousand times at random, a thousand in patches"
    ),
    "imaging_ring_patterns": Benchmark("imaging.ring_patterns", "the shipped ring beside a lattice and circles"),
    "live_mode": Benchmark(
        "imaging.live_mode", "images a second while the C-arm stands still, and whether memory grows"
    ),
    "hexapod_kinematics": Benchmark(
        "robot.hexapod_kinematics", "the robot's inverse and forward kinematics, beside plain NumPy"
    ),
    "guide_calibration": Benchmark("robot.guide_calibration", "the guide on the robot's head from eight images"),
    "robot_closed_loop": Benchmark(
        "robot.closed_loop", "what one more move makes of a wrong calibration and of a yielding mount"
    ),
    "robot_delivery": Benchmark(
        "robot.delivery", "commands duplicated, late, reordered, replayed and for another boot: at most one effect"
    ),
    "robot_head_check": Benchmark(
        "robot.head_check", "a wrong head extension and a turned guide, noticed from the first move"
    ),
    "robot_faults": Benchmark("robot.faults", "random faults, commands and events on the whole robot service"),
    "stop_latency": Benchmark("robot.stop_latency", "from a stop over REST to the stop byte on the controller's wire"),
    "robot_noise": Benchmark("robot.noise", "one byte in a hundred wrong on the hexapod controller's line"),
    "verification": Benchmark(
        "accuracy.verification", "K-wires from one image, from a pair, and with one from before the wires"
    ),
    "procedure": Benchmark("accuracy.procedure", "twenty seeded procedures in the virtual operating room"),
}
# Run by `distalock bench` without a name; the others need arguments.
_ALL: Final = tuple(name for name in BENCHMARKS if name != "same_results")
WITH_OPTIONS: Final = ("accuracy", "same_results", "independent_images", "cramer_rao", "noise_draws", "image_time")


def run_benchmarks(names: Sequence[str], options: Sequence[str] = ()) -> int:
    """Run the named benchmarks, or all; the exit code is that of the first that failed.

    `options` are those of one benchmark, whose `main` takes them.
    """
    if not (ROOT / "benchmarks").is_dir():
        print(f"distalock bench: there is no folder {ROOT / 'benchmarks'}; run from a checkout", file=sys.stderr)
        return EXIT_BAD_INPUT
    if options and tuple(names) not in {(name,) for name in WITH_OPTIONS}:
        known = ", ".join(WITH_OPTIONS)
        print(f"distalock bench: options go to one of the benchmarks that have some ({known})", file=sys.stderr)
        return EXIT_BAD_INPUT
    sys.path.insert(0, str(ROOT))
    if options:
        try:
            return int(_module(names[0]).main(options))
        except InputError as error:
            print(f"distalock bench {names[0]}: {error}", file=sys.stderr)
            return EXIT_BAD_INPUT
    codes = [int(_module(name).main()) for name in names or _ALL]
    return next((code for code in codes if code), 0)


def _module(name: str) -> ModuleType:
    return importlib.import_module(f"benchmarks.{BENCHMARKS[name].module}")
