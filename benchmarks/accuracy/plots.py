"""Pictures beside docs/benchmarks/accuracy.md: how errors are spread, what tilt does, and whether predictions hold."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import chi2

from benchmarks.accuracy.localised_scenes import SceneRow
from benchmarks.accuracy.report import limit_ratios, outcomes
from benchmarks.baselines.methods import LARGEST_AXIS_ERROR_DEG, LARGEST_ENTRY_ERROR_MM, Compared, Outcome

_COLOURS = {Compared.MODEL: "#1b7f4b", Compared.PAPER: "#c2321f", Compared.PAPER_RULE: "#d98f1f"}
_FAINT = "#9aa7b4"


def write_plots(rows: Sequence[SceneRow], folder: Path) -> tuple[str, ...]:
    """Write the pictures; returns their names."""
    mpl.use("Agg")
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    names = ("accuracy-errors.png", "accuracy-honesty.png")
    for name, draw in zip(names, (_errors, _honesty), strict=True):
        figure = draw(rows)
        figure.savefig(folder / name, dpi=110, metadata={"Software": None})
    return names


def _errors(rows: Sequence[SceneRow]) -> Figure:
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    entry, axis, tilt = figure.subplots(1, 3)
    for method in Compared:
        accepted = [one for one in outcomes(rows, method) if one.accepted]
        label = f"{method}, {len(accepted)} of {len(rows)}"
        _spread(entry, [o.entry_mm for o in accepted], method, label)
        _spread(axis, [o.axis_deg for o in accepted], method, label)
    for axes, limit, unit in (
        (entry, LARGEST_ENTRY_ERROR_MM, "entry error, mm"),
        (axis, LARGEST_AXIS_ERROR_DEG, "axis error, °"),
    ):
        axes.axvline(limit, color=_FAINT, linestyle=":")
        axes.set(xscale="log", xlabel=unit, ylabel="share of the accepted images", ylim=(0.0, 1.0))
    figure.legend(*axis.get_legend_handles_labels(), frameon=False, loc="outside upper left", ncols=3, fontsize=8)
    _over_tilt(tilt, rows)
    for scale in (entry.xaxis, axis.xaxis, tilt.yaxis):
        scale.set_major_formatter("{x:g}")
    return figure


def _spread(axes: Axes, values: Sequence[float | None], method: Compared, label: str) -> None:
    known = np.sort([value for value in values if value is not None])
    if len(known):
        share = np.linspace(0.0, 1.0, len(known) + 1)
        axes.step([known[0], *known], share, color=_COLOURS[method], label=label, where="post")


def _over_tilt(axes: Axes, rows: Sequence[SceneRow]) -> None:
    for method in reversed(Compared):
        points = [(r.kind.tilt_deg, o.axis_deg) for r in rows for o in outcomes([r], method) if o.accepted]
        if points:
            axes.plot(*np.array(points, dtype=np.float64).T, ".", color=_COLOURS[method], markersize=3, alpha=0.6)
    axes.axhline(LARGEST_AXIS_ERROR_DEG, color=_FAINT, linestyle=":")
    axes.set(yscale="log", xlabel="tilt of the hole to its ray, °", ylabel="axis error, °")


def _honesty(rows: Sequence[SceneRow]) -> Figure:
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    spread, size, limit = figure.subplots(1, 3)
    accepted = [row.model for row in rows if row.model.accepted]
    _normalised(spread, accepted)
    _predicted(size, accepted)
    _over_limit(limit, rows)
    for scale in (size.xaxis, size.yaxis):
        scale.set_major_formatter("{x:g}")
    return figure


def _normalised(axes: Axes, accepted: Sequence[Outcome]) -> None:
    """Error over prediction: the length of two independent normal errors with a total variance of one."""
    bins = np.linspace(0.0, 4.0, 33).tolist()
    holes = [hole for outcome in accepted for hole in outcome.holes or ()]
    for values, colour, label in (
        ([h.entry_mm / h.entry_sd_mm for h in holes if h.entry_sd_mm], "#2b6cb0", "entry"),
        ([h.axis_deg / h.axis_sd_deg for h in holes if h.axis_sd_deg], "#1b7f4b", "axis"),
    ):
        axes.hist(values, bins, density=True, histtype="step", color=colour, label=label)
    x = np.linspace(0.0, 4.0, 200)
    axes.plot(x, chi2.pdf(2.0 * x**2, 2) * 4.0 * x, color=_FAINT, linestyle="--", label="as predicted")
    axes.set(xlabel="error over predicted uncertainty", ylabel="density")
    axes.legend(frameon=False, fontsize=8)


def _predicted(axes: Axes, accepted: Sequence[Outcome]) -> None:
    pairs = [(h.axis_sd_deg, h.axis_deg) for o in accepted for h in o.holes or () if h.axis_sd_deg]
    if pairs:
        axes.plot(*np.array(pairs, dtype=np.float64).T, ".", color="#1b7f4b", markersize=3, alpha=0.6)
        ends = np.array([0.03, 1.0])
        axes.plot(ends, ends, color=_FAINT)
        axes.plot(ends, 2.0 * ends, color=_FAINT, linestyle=":")
    axes.set(xscale="log", yscale="log", xlabel="predicted axis uncertainty, °", ylabel="axis error, °")
    axes.set_ylim(0.003, 2.0)


def _over_limit(axes: Axes, rows: Sequence[SceneRow]) -> None:
    ratios = limit_ratios(rows)
    if ratios:
        axes.hist(
            ratios, np.linspace(0.0, 4.0, 25).tolist(), density=True, histtype="step", color="#1b7f4b", label="measured"
        )
        x = np.linspace(0.0, 4.0, 200)
        axes.plot(x, chi2.pdf(2.0 * x**2, 2) * 4.0 * x, color=_FAINT, linestyle="--", label="at the limit")
        axes.legend(frameon=False, fontsize=8)
    axes.set(xlabel="axis error over Cramér-Rao limit", ylabel="density")
