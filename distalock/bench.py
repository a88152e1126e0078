"""`distalock bench`: the statistics, whole. Each benchmark is a module of the `benchmarks` folder of a checkout."""

import importlib
import inspect
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from types import ModuleType
from typing import Final

from shared.arguments import EXIT_BAD_INPUT, OneLineParser
from shared.errors import InputError

ROOT: Final = Path(__file__).resolve().parent.parent
ALL: Final = "all"


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A module under `benchmarks`, whose `main` writes a page under docs/ and returns an exit code.

    Attributes
    ----------
    page
        Under `docs/benchmarks`, without its ending; empty where the result is printed only.
    needs_arguments
        Left out of `distalock bench all`.
    """

    module: str
    page: str
    measures: str
    needs_arguments: bool = False


BENCHMARKS: Final = {
    "accuracy": Benchmark(
        "accuracy.accuracy",
        "accuracy",
        "a thousand random scenes with random parts, by the model and by the paper's method, and the limit",
    ),
    "independent_images": Benchmark(
        "accuracy.independent_images",
        "independent",
        "every method on images that others rendered, where there is a folder of them",
    ),
    "sensitivity": Benchmark(
        "accuracy.sensitivity",
        "",
        "each tuned value 30 % larger and smaller: verdicts and errors on a fixed set of scenes",
        needs_arguments=True,
    ),
    "same_results": Benchmark(
        "accuracy.same_results",
        "",
        "verdicts and axes before and after a change, on the same images on file",
        needs_arguments=True,
    ),
    "cramer_rao": Benchmark(
        "limits.cramer_rao", "limit", "the smallest error possible in one random scene, and what it is made of"
    ),
    "noise_draws": Benchmark(
        "accuracy.noise_draws",
        "noise-draws",
        "scenes under many draws of noise: what is scatter, what stays, what was predicted",
    ),
    "locate_start": Benchmark(
        "accuracy.locate_start",
        "locate-start",
        "`distalock locate` as a process of its own beside a warm localisation; bad arguments",
    ),
    "image_time": Benchmark(
        "accuracy.image_time", "image-time", "how long one image takes, stage by stage, on both cores and on one"
    ),
    "ball_detection": Benchmark(
        "imaging.ball_detection",
        "balls",
        "balls covered in part, beside OpenCV's detectors, correlation and the Cramér-Rao limit",
    ),
    "calibration": Benchmark(
        "imaging.independent_calibration",
        "independent",
        "C-arm calibration on independent images, where there is a folder of them",
    ),
    "display": Benchmark(
        "accuracy.display", "display", "the same pictures with other curves, edges, bit depths and compression"
    ),
    "processing": Benchmark(
        "robustness.processing", "robustness", "images through what displays and C-arms do to them, kind by kind"
    ),
    "foreign_objects": Benchmark(
        "robustness.foreign_objects", "robustness", "images with things in the way of the beam, kind by kind"
    ),
    "bent_nails": Benchmark(
        "robustness.bent_nails", "robustness", "nails that are bent or made otherwise than their file says"
    ),
    "built_parts": Benchmark(
        "robustness.built_parts", "robustness", "rings, guides and nails built otherwise than their files say"
    ),
    "combined": Benchmark(
        "robustness.combined", "robustness", "two of those at once: bent nails, things in the way, parts, processing"
    ),
    "guidance": Benchmark(
        "accuracy.guidance",
        "guidance",
        "how to turn the C-arm, frame by frame: speed, errors, and the reasons when there is no advice",
    ),
    "fusion": Benchmark(
        "accuracy.fusion",
        "fusion",
        "one, two and three images of one set-up: errors, what they share, and guides that moved unseen",
    ),
    "model_errors": Benchmark(
        "accuracy.model_errors",
        "",
        "standard deviations of the nail model's own errors, fitted on scenes that judge nothing",
    ),
    "imaging_calibration": Benchmark(
        "imaging.calibration",
        "calibration",
        "C-arm calibration from 72 of 120 balls, beside OpenCV's models, polynomials and the limit",
    ),
    "imaging_gap": Benchmark(
        "imaging.calibration_gap",
        "calibration-gap",
        "where a calibration's error comes from: what is measured, and what the model leaves over",
    ),
    "imaging_fuzz": Benchmark(
        "imaging.fuzz", "fuzz", "damaged files and spoiled images: refused, or read and calibrated rightly"
    ),
    "imaging_identification": Benchmark(
        "imaging.identification",
        "identification",
        "the ring from 60 % of its balls, a thousand times at random, a thousand in patches",
    ),
    "imaging_ring_patterns": Benchmark(
        "imaging.ring_patterns", "ring-design", "the shipped ring beside a lattice and circles"
    ),
    "live_mode": Benchmark(
        "imaging.live_mode", "live-mode", "images a second while the C-arm stands still, and whether memory grows"
    ),
    "hexapod_kinematics": Benchmark(
        "robot.hexapod_kinematics", "robot-kinematics", "the robot's inverse and forward kinematics, beside plain NumPy"
    ),
    "guide_calibration": Benchmark(
        "robot.guide_calibration", "robot-guide-calibration", "the guide on the robot's head from eight images"
    ),
    "guide_scale": Benchmark(
        "accuracy.guide_scale", "", "whether images from two and three directions show a guide of another size"
    ),
    "robot_closed_loop": Benchmark(
        "robot.closed_loop",
        "robot-closed-loop",
        "what one more move makes of a wrong calibration and of a yielding mount",
    ),
    "robot_delivery": Benchmark(
        "robot.delivery",
        "robot-delivery",
        "commands duplicated, late, reordered, replayed and for another boot: at most one effect",
    ),
    "robot_head_check": Benchmark(
        "robot.head_check", "robot-head", "a wrong head extension and a turned guide, noticed from the first move"
    ),
    "robot_faults": Benchmark(
        "robot.faults", "robot-faults", "random faults, commands and events on the whole robot service"
    ),
    "stop_latency": Benchmark(
        "robot.stop_latency",
        "robot-stop",
        "from a stop over REST to the stop byte on the controller's wire, alone and under two loads",
    ),
    "soak": Benchmark(
        "robot.soak", "soak", "all clients at once for an hour: memory, handles, threads, queues, and stops"
    ),
    "soak_day": Benchmark(
        "robot.soak_day",
        "soak-day",
        "procedures of eight hours one after another: memory, handles, threads, what is kept, and stops",
    ),
    "process_loss": Benchmark(
        "faults.process_loss", "robot-process-loss", "each process killed and stopped in motion: time to rest, way"
    ),
    "slow_line": Benchmark(
        "robot.slow_line", "robot-slow-line", "a stop on a serial line of 115,200 baud: first byte, and locked"
    ),
    "robot_noise": Benchmark(
        "robot.noise", "robot-noise", "one byte in a hundred wrong on the hexapod controller's line"
    ),
    "faults": Benchmark(
        "faults.command",
        "",
        "every fault of processes, record, disks, clock, line and network at every step of the procedure "
        "(docs/faults.md)",
    ),
    "containers": Benchmark(
        "containers.command",
        "containers",
        "containers: sizes of images, first image beside the second, frames by shared memory, and each one killed, "
        "paused and cut off",
        needs_arguments=True,
    ),
    "rooms": Benchmark(
        "rooms.command",
        "rooms",
        "rooms at one site: latencies in one beside another's flood and the site's loss, and growth to 16",
    ),
    "upgrade": Benchmark(
        "upgrade.command",
        "upgrade",
        "a running room upgraded service by service from an earlier revision, a procedure after each change, and back",
        needs_arguments=True,
    ),
    "bus": Benchmark(
        "bus.bus", "bus", "frames of 2 MB and commands under mutual TLS and access control, beside bare Zenoh"
    ),
    "start": Benchmark(
        "bus.start", "start", "starts of `up --simulate` with certificates beside starts without, until it is ready"
    ),
    "consoles": Benchmark(
        "gateway.consoles",
        "consoles",
        "motion, stop and the gateway's memory while fifty consoles watch and one is stuck",
    ),
    "image_to_plan": Benchmark(
        "gateway.image_to_plan", "image-to-plan", "from an X-ray that comes in to a plan, beside `locate` that is warm"
    ),
    "console": Benchmark(
        "console.command",
        "console",
        "the console in a Chromium: accessibility, image to screen, frames, absent gateway, stop, load, set-up",
    ),
    "races": Benchmark(
        "gateway.races",
        "races",
        "two surgeons approve, move, take back and stop at once, in the virtual operating room",
    ),
    "state_read": Benchmark(
        "gateway.state_read", "state-read", "robot and case over the gateway beside a bare FastAPI route with a login"
    ),
    "verification": Benchmark(
        "accuracy.verification",
        "verification",
        "K-wires from one image, from a pair, and with one from before the wires",
    ),
    "procedure": Benchmark("accuracy.procedure", "procedure", "twenty seeded procedures in the virtual operating room"),
    "campaign": Benchmark(
        "campaign.campaign",
        "campaign",
        "a thousand procedures with errors of people, images out of the model and faults of hardware",
    ),
}


def print_list() -> int:
    """Print a table of the benchmarks; runs none of them."""
    if not _in_checkout():
        return EXIT_BAD_INPUT
    width = max(map(len, BENCHMARKS))
    print("distalock bench NAME [OPTIONS], NAME --help, or all; pages are in docs/benchmarks\n")
    for name, one in BENCHMARKS.items():
        print(f"{name:{width}}  {one.measures}" + (f" ({one.page}.md)" if one.page else ""))
    return 0


def is_benchmark(word: str) -> bool:
    """Whether a word names a benchmark, or all of them."""
    return word in BENCHMARKS or word == ALL


def run_benchmarks(words: Sequence[str]) -> int:
    """Run the benchmarks that the leading words name, or `all`; the exit code is that of the first that failed.

    The words from the first that names no benchmark are the arguments of the one benchmark that is named.
    """
    if not _in_checkout():
        return EXIT_BAD_INPUT
    names = list(takewhile(is_benchmark, words))
    options = words[len(names) :]
    chosen = [name for name, one in BENCHMARKS.items() if not one.needs_arguments] if ALL in names else names
    if options and len(chosen) > 1:
        print("distalock bench: options belong to one benchmark; name one", file=sys.stderr)
        return EXIT_BAD_INPUT
    sys.path.insert(0, str(ROOT))
    codes = [_run(name, options) for name in chosen]
    return next((code for code in codes if code), 0)


def _in_checkout() -> bool:
    if (ROOT / "benchmarks").is_dir():
        return True
    print(
        f"distalock bench: there is no folder {ROOT / 'benchmarks'}; benchmarks need a checkout of the sources",
        file=sys.stderr,
    )
    return False


def _run(name: str, options: Sequence[str]) -> int:
    main = _module(name).main
    try:
        if "arguments" in inspect.signature(main).parameters:
            return int(main(list(options)))
        OneLineParser(prog=f"distalock bench {name}", description=BENCHMARKS[name].measures).parse_args(list(options))
        return int(main())
    except InputError as error:
        print(f"distalock bench {name}: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _module(name: str) -> ModuleType:
    return importlib.import_module(f"benchmarks.{BENCHMARKS[name].module}")
