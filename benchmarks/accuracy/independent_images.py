"""The same tables from images that others rendered: every method on each, beside the truth.

usage: distalock bench independent_images [--only dev0] [--report docs/benchmarks/independent.md]

Looks for the images in the folder named by DISTALOCK_FLUOROSCOPY, or in ../shared/fluoroscopy; without them there is
nothing to do. Returns 1 when an axis was accepted though it is off, or an image that must be refused was not.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.capture import Capture, capture_of
from benchmarks.accuracy.report import methods_table
from benchmarks.baselines.methods import Compared, Outcome, peer_seconds, run_model, run_paper, run_paper_rule
from benchmarks.data.independent_images import (
    Expected,
    ListedImage,
    Truth,
    independent_folder,
    listed_images,
    nearest_pose,
)
from distalock.arguments import OneLineParser, writable_file
from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.image_file import read_image
from services.registration.frames import parts_from_json
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.geometry.frames import Nail, Ring
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class KnownHole:
    """What is true of a hole."""

    id: str
    entry_point_guide_mm: NDArray[np.float64]
    axis_guide: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImageRow:
    """What came out for one image; `expect` says whether it should be accepted, must be refused, or either."""

    image: str
    tilt_deg: float
    expect: Expected
    by_method: dict[Compared, Outcome]
    capture: Capture
    peer_seconds: float


def image_rows(folder: Path, only: str = "") -> list[ImageRow]:
    """All methods on the images whose names contain some text."""
    rows = []
    for image in listed_images(folder):
        if only in image.name:
            rows.append(_row(image))
            print(_line(rows[-1]), flush=True)
    return rows


def _row(image: ListedImage) -> ImageRow:
    entry, truth = image.entry, image.truth()
    ring, guide, nail = (file.read_bytes() for file in (image.ring, image.guide, image.nail))
    names = (image.ring.name, image.guide.name, image.nail.name)
    parts = parts_from_json(ring, guide, nail, USUAL_DRILL_DIAMETER_MM, names)
    pixels = read_image(image.path.read_bytes(), image.name).pixels
    holes = [KnownHole(h.id, np.array(h.entry_point_guide_mm), np.array(h.axis_guide)) for h in truth.holes]
    nominal = NominalGeometry(entry.nominal.source_to_detector_mm, entry.nominal.pixel_mm)
    run = run_model(pixels, nominal, parts, holes)
    by_method = {Compared.MODEL: run.outcome}
    if run.calibration is not None:
        by_method[Compared.PAPER] = run_paper(pixels, run.calibration, parts, holes)
    rule = run_paper_rule(pixels, run, parts, holes)
    if rule is not None:
        by_method[Compared.PAPER_RULE] = rule
    captured = capture_of(pixels, run, parts, _ring_from_nail(truth))
    return ImageRow(entry.image, entry.tilt_deg, entry.expect, by_method, captured, peer_seconds(pixels))


def _ring_from_nail(truth: Truth) -> Transform[Ring, Nail]:
    assert truth.camera_from_nail is not None
    ring_from_nail = np.linalg.inv(truth.camera_from_ring) @ np.array(truth.camera_from_nail)
    return Transform.from_matrix(nearest_pose(ring_from_nail.tolist()))


def _line(row: ImageRow) -> str:
    cells = []
    for method in Compared:
        outcome = row.by_method.get(method)
        cells.append("-" if outcome is None else _cell(outcome))
    return f"| {row.image} | {row.tilt_deg:g}° | {row.expect} | {' | '.join(cells)} | {row.capture} |"


def _cell(outcome: Outcome) -> str:
    if not outcome.accepted:
        return ", ".join(outcome.codes)
    return f"{outcome.entry_mm:.3f} mm, {outcome.axis_deg:.3f}°"


def report(rows: Sequence[ImageRow]) -> str:
    """Summary over the images that should be accepted, then one line per image, as Markdown."""
    good = [row for row in rows if row.expect == "accept"]
    bad = [row for row in rows if row.expect == "reject"]
    by_method = {method: [row.by_method[method] for row in good if method in row.by_method] for method in Compared}
    accepted = sum(row.by_method[Compared.MODEL].accepted for row in bad)
    ended = ", ".join(f"{sum(row.capture is capture for row in good)} {capture}" for capture in Capture)
    lines = [
        "# Accuracy on independent images",
        "",
        "Made by `distalock bench independent_images`; `accuracy.md` says what the columns and methods are.",
        "",
        methods_table(by_method, [row.peer_seconds for row in good]).rstrip(),
        "",
        f"Of {len(bad)} images that must be refused, our own method accepted {accepted}.",
        f"Its search for the nail in the {len(good)} that should be accepted ended: {ended}.",
        "",
        "| image | tilt | expected | model | paper | paper's rule | search |",
        "|---|---|---|---|---|---|---|",
        *map(_line, rows),
    ]
    return "\n".join([*lines, ""])


def main(arguments: Sequence[str] = ()) -> int:
    """Run all methods on the images and print the tables."""
    parser = OneLineParser(
        prog="distalock bench independent_images",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", default="", help="images whose names contain this")
    parser.add_argument("--report", type=writable_file, help="file for the tables too")
    given = parser.parse_args(list(arguments))
    folder = independent_folder()
    if folder is None:
        print("the independent images are not here; name their folder in DISTALOCK_FLUOROSCOPY")
        return 0
    rows = image_rows(folder, given.only)
    text = report(rows)
    print(text)
    if given.report is not None:
        given.report.write_text(text)
    model = [(row, row.by_method[Compared.MODEL]) for row in rows]
    return int(any(outcome.accepted and (row.expect == "reject" or outcome.off) for row, outcome in model))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
