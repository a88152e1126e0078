"""What the localisation made of one scene of a kind, and the summary of many."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.baselines.methods import LARGEST_AXIS_ERROR_DEG, LARGEST_ENTRY_ERROR_MM, run_model
from benchmarks.common.statistics import Quantiles, quantiles, root_mean_square
from benchmarks.robustness.kinds import Kind
from benchmarks.robustness.scene import BESIDE_FILE_MM, COVERED, Drawn, ImageFolder, RobustScene

LARGEST_NORMALISED = 4.0
LARGEST_COVERED = 0.5
# A part that differs from its file by more is to be refused, not localised.
LARGEST_BESIDE_FILE_MM = 0.2
_CRASHED = "crashed: "
# A result within these is good enough to drill by.
GOOD_ENTRY_MM, GOOD_AXIS_DEG = 0.2, 0.6


@dataclass(frozen=True, slots=True)
class HoleScore:
    """Errors of one hole against its own truth, and their predicted rms (None where there is no prediction)."""

    id: str
    entry_mm: float
    axis_deg: float
    entry_sd_mm: float | None
    axis_sd_deg: float | None

    @property
    def wrong(self) -> bool:
        """Further off than an accepted axis may be, or not a number."""
        return not (self.entry_mm <= LARGEST_ENTRY_ERROR_MM and self.axis_deg <= LARGEST_AXIS_ERROR_DEG)

    @property
    def good(self) -> bool:
        """Good enough to drill by."""
        return self.entry_mm <= GOOD_ENTRY_MM and self.axis_deg <= GOOD_AXIS_DEG


@dataclass(frozen=True, slots=True)
class Row:
    """One scene of a kind.

    Attributes
    ----------
    drawn
        Parameters of the kind.
    control
        Codes of the same seed without the kind: empty when it was accepted.
    codes
        Why it was refused; a crash is a code of its own.
    holes
        Errors of the axes that were found, refused or not.
    """

    kind: str
    seed: int
    drawn: Drawn
    control: tuple[str, ...]
    codes: tuple[str, ...]
    holes: tuple[HoleScore, ...] | None
    seconds: float

    @property
    def accepted(self) -> bool:
        """Whether axes were offered."""
        return not self.codes

    @property
    def usable(self) -> bool:
        """Whether a result is wanted: accepted without the kind, each rim at least half free, the nail as its file."""
        if self.control or float(self.drawn.get(BESIDE_FILE_MM, 0.0)) > LARGEST_BESIDE_FILE_MM:
            return False
        covered = [float(share) for name, share in self.drawn.items() if name.startswith(COVERED)]
        return max(covered, default=0.0) <= LARGEST_COVERED

    @property
    def wrong(self) -> bool:
        """Accepted although an axis is too far off."""
        return self.accepted and (self.holes is None or any(hole.wrong for hole in self.holes))

    @property
    def crashed(self) -> bool:
        """Whether the localisation raised an exception."""
        return any(code.startswith(_CRASHED) for code in self.codes)

    @property
    def good(self) -> bool:
        """Accepted, with all axes good enough to drill by."""
        return self.accepted and self.holes is not None and all(hole.good for hole in self.holes)


def key_of(kind: str, seed: int) -> str:
    """The key of a row on file."""
    return f"{kind}/{seed}"


def kind_row(kinds: Sequence[Kind], controls: Mapping[int, tuple[str, ...]], images: Path | None, key: str) -> Row:
    """Make the scene of a key and localise in it.

    Parameters
    ----------
    controls
        Codes of the controls by seed; a seed without one is its own control.
    """
    name, seed = key.split("/")
    kind = next(one for one in kinds if one.name == name)
    scene = kind.make(int(seed), ImageFolder(images))
    started = time.perf_counter()
    codes, holes = localised(scene)
    seconds = time.perf_counter() - started
    return Row(name, int(seed), scene.drawn, controls.get(int(seed), codes), codes, holes, seconds)


def localised(scene: RobustScene) -> tuple[tuple[str, ...], tuple[HoleScore, ...] | None]:
    """Codes of refusal, and the errors of the axes that were found."""
    try:
        outcome = run_model(scene.pixels.astype(np.float32), scene.nominal, scene.parts, scene.holes).outcome
    except Exception as error:  # noqa: BLE001 - a crash on one scene is counted, and the others go on
        return (f"{_CRASHED}{type(error).__name__}: {error}",), None
    if outcome.holes is None:
        return outcome.codes, None
    found = zip(scene.holes, outcome.holes, strict=True)
    return outcome.codes, tuple(
        HoleScore(truth.id, hole.entry_mm, hole.axis_deg, hole.entry_sd_mm, hole.axis_sd_deg) for truth, hole in found
    )


@dataclass(frozen=True, slots=True)
class Summary:
    """All scenes of one kind.

    Attributes
    ----------
    refused
        How often each code, the most frequent first.
    usable, usable_accepted, usable_good
        Scenes that a person could use, how many of them are accepted, and how many of those are good.
    entry_mm, axis_deg
        Median, 95 % and worst of the worse hole of accepted scenes.
    normalised_entry, normalised_axis
        Errors of all holes over their predicted rms, rms.
    beyond
        Accepted scenes with an error beyond four times its predicted rms.
    """

    scenes: int
    accepted: int
    wrong: int
    refused: tuple[tuple[str, int], ...]
    usable: int
    usable_accepted: int
    usable_good: int
    entry_mm: Quantiles
    axis_deg: Quantiles
    normalised_entry: float
    normalised_axis: float
    beyond: int


def summary_of(rows: Sequence[Row]) -> Summary:
    """Counts and quantiles of some rows."""
    accepted = [row for row in rows if row.accepted and row.holes is not None]
    usable = [row for row in rows if row.usable]
    normal = {id(row): _normalised(row) for row in accepted}
    entry = [pair[0] for pairs in normal.values() for pair in pairs]
    axis = [pair[1] for pairs in normal.values() for pair in pairs]
    return Summary(
        scenes=len(rows),
        accepted=len(accepted),
        wrong=sum(row.wrong for row in rows),
        refused=tuple(Counter(code for row in rows for code in row.codes).most_common()),
        usable=len(usable),
        usable_accepted=sum(row.accepted for row in usable),
        usable_good=sum(row.good for row in usable),
        entry_mm=quantiles(max(hole.entry_mm for hole in row.holes or ()) for row in accepted),
        axis_deg=quantiles(max(hole.axis_deg for hole in row.holes or ()) for row in accepted),
        normalised_entry=root_mean_square(entry),
        normalised_axis=root_mean_square(axis),
        beyond=sum(bool(np.max(pairs, initial=0.0) > LARGEST_NORMALISED) for pairs in normal.values()),
    )


def _normalised(row: Row) -> list[tuple[float, float]]:
    """Entry and axis error over the predicted rms, hole by hole."""
    return [
        (hole.entry_mm / hole.entry_sd_mm, hole.axis_deg / hole.axis_sd_deg)
        for hole in row.holes or ()
        if hole.entry_sd_mm and hole.axis_sd_deg
    ]
