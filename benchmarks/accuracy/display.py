"""What the display does to the answer: the same X-rays with other curves, edges, bit depths and compression.

For each seeded scene the axes found in its image are compared with those found after each change of the picture. The
change should stay within the predicted uncertainty, and a picture that cannot be used must be refused. Writes
docs/benchmarks/display.md.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.localised_scenes import AxisErrors, compared
from benchmarks.common.places import PAGES
from benchmarks.common.statistics import root_mean_square
from benchmarks.scenes.random_scenes import scene_of_seed
from simulation.render.image import Shot, render_scene
from simulation.scenario.values import Scenario
from simulation.world.poses import starting_state

FIRST_SEED, SCENES, PROCESSES = 7000, 8, 2
REPORT = PAGES / "display.md"
UNCHANGED = "as rendered"
# A change of the picture adds noise of its own (rounding, compression) and another error of the model: more than this
# many standard uncertainties from the truth, over all holes of all scenes, is more than chance.
LARGEST_NORMALISED = 1.6

Grey = NDArray[np.float32]
Change = Callable[[Grey], Grey]


def _curve(gamma: float) -> Change:
    return lambda share: np.asarray(share**gamma, dtype=np.float32)


def _sharpened(share: Grey) -> Grey:
    return np.asarray(np.clip(share + 0.8 * (share - cv2.GaussianBlur(share, (0, 0), 2.0)), 0.0, 1.0), dtype=np.float32)


def _eight_bits(share: Grey) -> Grey:
    return np.asarray(np.rint(255.0 * share) / 255.0, dtype=np.float32)


def _compressed(share: Grey) -> Grey:
    written, code = cv2.imencode(".jpg", np.rint(255.0 * share).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert written
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE), dtype=np.float32) / np.float32(255.0)


def _burnt_out(share: Grey) -> Grey:
    return np.asarray(np.minimum(share / np.quantile(share, 0.85), 1.0), dtype=np.float32)


CHANGES: dict[str, Change] = {
    UNCHANGED: lambda share: share,
    "gamma 0.6": _curve(0.6),
    "gamma 0.8": _curve(0.8),
    "gamma 1.25": _curve(1.25),
    "gamma 1.6": _curve(1.6),
    "edges enhanced (0.8, 2 px)": _sharpened,
    "8 bits": _eight_bits,
    "JPEG, quality 90": _compressed,
    "brightest 15 % burnt out": _burnt_out,
}


@dataclass(frozen=True, slots=True)
class Row:
    """One scene under one change."""

    seed: int
    change: str
    codes: tuple[str, ...]
    errors: AxisErrors | None
    wrong: bool


def rows_of_scene(seed: int) -> list[Row]:
    """All changes of one scene's picture, localised."""
    scenario = scene_of_seed(seed)
    shot = render_scene(scenario, starting_state(scenario))
    return [_row(seed, name, change, scenario, shot) for name, change in CHANGES.items()]


def _row(seed: int, name: str, change: Change, scenario: Scenario, shot: Shot) -> Row:
    largest = float(np.iinfo(shot.pixels.dtype).max)
    changed = change(shot.pixels.astype(np.float32) / np.float32(largest)) * np.float32(largest)
    result = compared(seed, scenario, changed, shot.truth)
    return Row(seed, name, result.codes, result.model, result.wrong)


def main() -> int:
    """Run all scenes and write the report; 0 when nothing accepted is wrong and errors stay as predicted."""
    rows: list[Row] = []
    with ProcessPoolExecutor(PROCESSES) as pool:
        for of_scene in pool.map(rows_of_scene, range(FIRST_SEED, FIRST_SEED + SCENES)):
            rows += of_scene
            print(
                f"seed {of_scene[0].seed}: {sum(not r.codes for r in of_scene)} of {len(of_scene)} accepted", flush=True
            )
    REPORT.write_text(report(rows))
    print(REPORT.read_text())
    honest = all(_normalised(rows, name)[1] < LARGEST_NORMALISED for name in CHANGES)
    return 0 if honest and not any(r.wrong for r in rows) else 1


def _accepted(rows: list[Row], name: str) -> list[AxisErrors]:
    return [r.errors for r in rows if r.change == name and not r.codes and r.errors is not None]


def _normalised(rows: list[Row], name: str) -> tuple[float, float]:
    errors = _accepted(rows, name)
    return (
        root_mean_square(e.normalised_entry for e in errors),
        root_mean_square(e.normalised_axis for e in errors),
    )


def report(rows: list[Row]) -> str:
    """The table, as Markdown."""
    lines = [
        "# What the display does to the answer",
        "",
        f"`distalock bench display`: {SCENES} random scenes from seed {FIRST_SEED}, each picture under every change.",
        "Errors against the truth of accepted pictures; normalised: over the predicted standard uncertainty, rms.",
        "",
        "| picture | accepted | entry, median / worst | axis, median / worst | normalised entry, axis | refused for |",
        "|---|---|---|---|---|---|",
    ]
    for name in CHANGES:
        errors = _accepted(rows, name)
        entry, axis = ([getattr(e, key) for e in errors] or [float("nan")] for key in ("entry_mm", "axis_deg"))
        normal = _normalised(rows, name)
        codes = sorted({code for r in rows if r.change == name for code in r.codes})
        lines.append(
            f"| {name} | {len(errors)} of {sum(r.change == name for r in rows)} "
            f"| {np.median(entry):.3f} / {max(entry):.3f} mm | {np.median(axis):.3f} / {max(axis):.3f}° "
            f"| {normal[0]:.2f}, {normal[1]:.2f} | {', '.join(codes) or '-'} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
