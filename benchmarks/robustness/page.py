"""The page: one section of each benchmark, with a table by kind and a picture of each kind."""

import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common.statistics import text_of
from benchmarks.robustness.kinds import Kind
from benchmarks.robustness.rows import Row, Summary, summary_of
from benchmarks.robustness.scene import ImageFolder, RobustScene

_HEAD = """# Robust on images that real C-arms make

`distalock bench processing`, `foreign_objects`, `bent_nails`, `built_parts` and `combined`: seeded scenes with random
parts, through what displays, C-arms and operating rooms do, one thing or two at once. Parameters of each kind are drawn
from the seed. Seeds 60000-64999 fit parameters of the localisation (`--seeds fit`); seeds 65000-69999 judge and fit
nothing (`--seeds judged`), with some kinds that are held out: they run on these seeds alone. Every hole is compared
with its own true axis. The columns:

- *wrong*: accepted with an axis more than 1.5° or 1 mm (at the entry) off.
- *usable*: scenes whose control, the same seed without the kind, is accepted, where a foreign object covers at most
  half of each hole next to its rim, and where the holes lie as filed within 0.2 mm (others are to be refused); how many
  of these are accepted, and how many of those are within 0.6° and 0.2 mm.
- *entry*, *axis*: median / 95 % / worst of the worse hole, accepted scenes.
- *normalised*: error over its predicted rms, as rms over all holes of accepted scenes (entry, axis).
- *> 4*: accepted scenes with an error beyond four times its predicted rms.

The localisation always gets the nominal part files, with other holes only where a kind says what the file says. The
guide's frame is that of its file, also where its balls were displaced. A bent nail keeps the place and the tangent of
its file halfway between its holes; each hole's true axis is square to the centreline at its own place, as the file has
it there.

`--images FOLDER` keeps rendered images with their truth (`<kind>/<seed>.png` and `.json`), so that the next run need
not render; delete the folder of a kind whose code changed. `benchmarks.robustness.all_kinds.make_scene(kind, seed)`
makes one scene, `benchmarks.robustness.rows.localised(scene)` scores it. `--rows FILE` keeps a row of each scene: kind,
parameters, the control's verdict, codes, errors and predictions hole by hole; `--before FILE` puts the rows of an
earlier revision beside those of this one. Rows of
judged scenes are kept in [rows](rows), each with its revision: with `--rows docs/benchmarks/rows/<bench>.jsonl` a run
goes on from them, for as long as the estimation is the same. What earlier changes did to the same images is in
[before and after each change](robustness-changes.md), rows of those revisions in [rows/earlier](rows/earlier).

"""
_COLUMNS = (
    "kind",
    "scenes",
    "accepted",
    "wrong",
    "usable: accepted, good",
    "entry, mm",
    "axis, °",
    "normalised",
    "> 4",
    "refused for",
)
_TABLE = (f"| {' | '.join(_COLUMNS)} |", "|---" * len(_COLUMNS) + "|")
_TILE_PX, _CROP_PX, _ACROSS, _LABEL_PX, _GREY_STEP = 128, 300, 6, 16, 12


def section_of(name: str, seeds: str, kinds: Sequence[Kind], rows: Sequence[Row], before: Sequence[Row] | None) -> str:
    """A benchmark's part of the page, as Markdown; `before` are rows of an earlier revision."""
    lines = [f"## {name}", "", f"![pictures of the kinds](robustness-{name}.png)", ""]
    lines += [f"- `{kind.name}`: {kind.what}{' (Held out.)' * kind.judges_only}" for kind in kinds]
    lines += ["", f"Seeds {seeds}.", ""]
    if before is None:
        return "\n".join([*lines, *table_of(rows), ""])
    keys = {(row.kind, row.seed) for row in rows}
    earlier = [row for row in before if (row.kind, row.seed) in keys]
    return "\n".join([*lines, "Before:", "", *table_of(earlier), "", "After:", "", *table_of(rows), ""])


def with_section(page: Path, name: str, section: str) -> str:
    """The page's text with one section new; sections of other benchmarks stay, in the order of their names."""
    text = page.read_text() if page.exists() else ""
    parts = re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]
    sections = {part.split("\n", 1)[0]: part.rstrip() + "\n" for part in parts}
    sections[f"## {name}"] = section.rstrip() + "\n"
    return _HEAD + "\n".join(sections[heading] for heading in sorted(sections))


def table_of(rows: Sequence[Row]) -> list[str]:
    """Lines of the table by kind, in the order of the rows."""
    of_kind = {kind: [row for row in rows if row.kind == kind] for kind in dict.fromkeys(row.kind for row in rows)}
    return [*_TABLE, *(_line(kind, summary_of(found)) for kind, found in of_kind.items())]


def _line(kind: str, s: Summary) -> str:
    refused = ", ".join(f"{code} {count}" for code, count in s.refused) or "-"
    normal = "-" if np.isnan(s.normalised_entry) else f"{s.normalised_entry:.2f}, {s.normalised_axis:.2f}"
    return (
        f"| {kind} | {s.scenes} | {s.accepted} | {s.wrong} "
        f"| {s.usable}: {s.usable_accepted}, {s.usable_good} "
        f"| {text_of(s.entry_mm)} | {text_of(s.axis_deg, 2)} | {normal} | {s.beyond} | {refused} |"
    )


def write_sheet(file: Path, kinds: Sequence[Kind], seed: int, images: Path | None) -> None:
    """One picture of each kind about the nail's holes, of the same seed, with its name."""
    tiles = [_tile(kind.name, kind.make(seed, ImageFolder(images))) for kind in kinds]
    blank = np.zeros_like(tiles[0])
    tiles += [blank] * (-len(tiles) % _ACROSS)
    sheet = np.vstack([np.hstack(tiles[k : k + _ACROSS]) for k in range(0, len(tiles), _ACROSS)])
    cv2.imwrite(str(file), sheet // _GREY_STEP * _GREY_STEP, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _tile(name: str, scene: RobustScene) -> NDArray[np.uint8]:
    """A crop that shows the same part of the scene in images of every size."""
    size = scene.pixels.shape[0]
    half = _CROP_PX * size // 2048
    column, row = (int(np.clip(place, half, size - half)) for place in scene.middle_px)
    crop = scene.pixels[row - half : row + half, column - half : column + half]
    grey = np.asarray(crop / np.iinfo(scene.pixels.dtype).max * 255.0, dtype=np.uint8)
    picture = cv2.resize(grey, (_TILE_PX, _TILE_PX), interpolation=cv2.INTER_AREA)
    label = np.zeros((_LABEL_PX, _TILE_PX), dtype=np.uint8)
    cv2.putText(label, name, (2, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.33, 255, 1, cv2.LINE_AA)
    return np.vstack([label, picture]).astype(np.uint8)
