"""Verdicts and axes before and after a change, on the same images: 300 scenes on file, and the independent images.

usage: distalock bench same_results scenes FOLDER [--count 300] [--seed 30000]
       distalock bench same_results locate FOLDER... --results FILE
       distalock bench same_results compare BEFORE AFTER [--subset]

`scenes` renders scenes once into a folder: images, part files and a manifest like that of the independent images.
`locate` localises every image of such folders and writes one JSON line each; it is run on both revisions.
`compare` lists every image whose verdict or reason codes differ, and the largest difference of an axis, in predicted
standard deviations. It returns 1 when a verdict differs or an axis moved by more than 0.01 standard deviations.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.common.runner import run_jobs
from benchmarks.data.independent_images import ListedImage, listed_images
from benchmarks.scenes.random_scenes import scene_of_seed
from benchmarks.scenes.varied_parts import write_parts
from distalock.locate import NominalOptions, locate_image, read_parts
from shared.arguments import OneLineParser
from shared.json_lines import json_lines
from simulation.render.image import render_scene
from simulation.world.poses import starting_state

LARGEST_SHIFT_SD = 0.01
TRUTH_FILE = "truth.json"
FIRST_SEED, SCENES = 30_000, 300


class Subset(Enum):
    """Whether the second run may have fewer images than the first."""

    ALLOWED = "allowed"
    REFUSED = "refused"


def main(arguments: Sequence[str] = ()) -> int:
    """Write scenes, localise, or compare two runs; 0 when nothing differs."""
    given = _options(arguments)
    match given.action:
        case "scenes":
            return write_scenes(given.folder, range(given.seed, given.seed + given.count))
        case "locate":
            return write_results(given.folders, given.results)
        case _:
            return compare(given.before, given.after, Subset.ALLOWED if given.subset else Subset.REFUSED)


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = OneLineParser(prog="distalock bench same_results", description="before and after a change")
    actions = parser.add_subparsers(dest="action", required=True)
    scenes = actions.add_parser("scenes", help="render scenes into a folder")
    scenes.add_argument("folder", type=Path)
    scenes.add_argument("--count", type=int, default=SCENES)
    scenes.add_argument("--seed", type=int, default=FIRST_SEED)
    locate = actions.add_parser("locate", help="localise every image of folders")
    locate.add_argument("folders", type=Path, nargs="+")
    locate.add_argument("--results", type=Path, required=True)
    comparison = actions.add_parser("compare", help="compare two files of results")
    comparison.add_argument("before", type=Path)
    comparison.add_argument("after", type=Path)
    comparison.add_argument("--subset", action="store_true", help="images in one file only do not count")
    return parser.parse_args(list(arguments))


def write_scenes(folder: Path, seeds: Sequence[int]) -> int:
    """Render the scenes of some seeds, with the part files that a localisation gets."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = list(run_jobs(partial(_write_scene, folder), seeds, dict[str, Any]).values())
    (folder / "manifest.json").write_text(json.dumps({"images": entries}, indent=1))
    return 0


def _write_scene(folder: Path, seed: int) -> dict[str, Any]:
    scenario = scene_of_seed(seed)
    files = folder / f"{seed}"
    files.mkdir(exist_ok=True)
    write_parts(files, np.random.default_rng([seed, *b"varied parts"]))
    nail = json.loads((files / "nail.json").read_text())
    for hole in nail["holes"]:
        del hole["chamfer_mm"]  # makers do not say how their holes are chamfered
    (files / "nail.json").write_text(json.dumps(nail))
    shot = render_scene(scenario, starting_state(scenario))
    cv2.imwrite(str(files / "image.png"), shot.pixels)
    parts = {kind: f"{seed}/{kind}.json" for kind in ("ring", "guide", "nail")}
    c_arm = scenario.c_arm
    nominal = {"source_to_detector_mm": c_arm.nominal_source_to_detector_mm, "pixel_mm": c_arm.nominal_pixel_mm}
    holes = shot.truth.holes
    truth = {h.id: {"entry_mm": h.entry_point_guide_mm.tolist(), "axis": h.axis_guide.tolist()} for h in holes}
    (files / TRUTH_FILE).write_text(json.dumps(truth))
    return {"image": f"{seed}/image.png", "nominal": nominal, **parts}


def write_results(folders: Sequence[Path], results: Path) -> int:
    """Localise every image of the folders' manifests, one JSON line each."""
    jobs = {f"{image.folder.name}/{image.name}": image for folder in folders for image in listed_images(folder)}
    rows = run_jobs(partial(_named_row, jobs), list(jobs), dict[str, Any])
    results.write_text("".join(json.dumps(row) + "\n" for row in rows.values()))
    return 0


def _named_row(jobs: dict[str, ListedImage], name: str) -> dict[str, Any]:
    return located_row(jobs[name])


def located_row(listed: ListedImage) -> dict[str, Any]:
    """Localise an image; where the true holes stand beside it, with the true entry errors."""
    parts = read_parts(listed.ring, listed.guide, listed.nail)
    message = locate_image(listed.path, parts, NominalOptions(**listed.entry.nominal.model_dump())).message
    holes = {
        hole.id: {
            "entry_mm": hole.entry_point_guide_mm,
            "axis": hole.axis_guide,
            "entry_sd_mm": None if hole.standard_uncertainty is None else hole.standard_uncertainty.entry_mm,
            "axis_sd_deg": None if hole.standard_uncertainty is None else hole.standard_uncertainty.axis_deg,
        }
        for hole in message.holes or ()
    }
    codes = [str(reason.code) for reason in message.reasons]
    messages = [reason.message for reason in message.reasons]
    image = f"{listed.folder.name}/{listed.name}"
    row = {"image": image, "verdict": message.verdict, "codes": codes, "messages": messages, "holes": holes}
    truth = listed.path.with_name(TRUTH_FILE)
    true = json.loads(truth.read_text()) if truth.is_file() else {}
    return row | {"entry_errors_mm": [_across_mm(hole, true[name]) for name, hole in holes.items() if name in true]}


def _across_mm(hole: dict[str, Any], true: dict[str, Any]) -> float:
    """Distance of an entry point from the true one, across the true axis."""
    apart, axis = np.array(hole["entry_mm"]) - true["entry_mm"], np.array(true["axis"])
    return float(np.linalg.norm(apart - axis * (apart @ axis)))


def compare(before: Path, after: Path, subset: Subset) -> int:
    """Print what differs between two runs."""
    first, second = _by_image(before), _by_image(after)
    images = sorted(first.keys() & second.keys())
    print(f"{len(images)} images in both, {len(first.keys() ^ second.keys())} in one only")
    if not images:
        return 1
    different = [name for name in images if verdict_of(first[name]) != verdict_of(second[name])]
    for name in different:
        print(f"{name}: {verdict_of(first[name])} before, {verdict_of(second[name])} after")
    shifts = sorted(((shift_sd(first[name], second[name]), name) for name in images), reverse=True)
    for shift, name in shifts[:10]:
        print(f"{name}: an axis moved by {shift:.6f} standard deviations")
    print(f"verdicts differ: {len(different)}; largest shift {shifts[0][0]:.6f} standard deviations")
    incomplete = subset is Subset.REFUSED and first.keys() != second.keys()
    return int(bool(different) or shifts[0][0] > LARGEST_SHIFT_SD or incomplete)


def _by_image(file: Path) -> dict[str, dict[str, Any]]:
    return {row["image"]: row for row in map(json.loads, json_lines(file.read_text()))}


def verdict_of(row: dict[str, Any]) -> tuple[str, ...]:
    """Verdict and reason codes."""
    return (row["verdict"], *row["codes"])


def shift_sd(before: dict[str, Any], after: dict[str, Any]) -> float:
    """Largest difference of an entry point or an axis, and of their predicted deviations, in standard deviations."""
    if before["holes"].keys() != after["holes"].keys():
        return float("inf")
    return max((_hole_shift_sd(hole, after["holes"][name]) for name, hole in before["holes"].items()), default=0.0)


def _hole_shift_sd(before: dict[str, Any], after: dict[str, Any]) -> float:
    if not before["entry_sd_mm"] or not before["axis_sd_deg"]:
        return 0.0
    axis = np.array(before["axis"])
    apart = np.array(after["entry_mm"]) - before["entry_mm"]
    across_mm = float(np.linalg.norm(apart - axis * (apart @ axis)))
    turned_deg = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, after["axis"])), axis @ after["axis"])))
    predicted = max(
        abs(after["entry_sd_mm"] / before["entry_sd_mm"] - 1.0), abs(after["axis_sd_deg"] / before["axis_sd_deg"] - 1.0)
    )
    shift = max(across_mm / before["entry_sd_mm"], turned_deg / before["axis_sd_deg"], predicted)
    return float(shift)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
