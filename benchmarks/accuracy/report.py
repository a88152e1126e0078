"""The tables of docs/benchmarks/accuracy.md from what came out of many scenes."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import assert_never

import numpy as np

from benchmarks.accuracy.capture import Capture
from benchmarks.accuracy.localised_scenes import SceneRow, normalised
from benchmarks.accuracy.strata import STRATA
from benchmarks.baselines.methods import LARGEST_AXIS_ERROR_DEG, LARGEST_ENTRY_ERROR_MM, Compared, HoleError, Outcome
from benchmarks.common.statistics import quantiles, root_mean_square, text_of
from benchmarks.limits.cramer_rao import AxisLimit

_HEAD = """# Accuracy on random scenes

`distalock bench accuracy --count {count} --seed {seed}` (sources: {revisions}): scenes of the virtual operating room,
each with its own ball patterns and nail, tilts up to 10°, 200 to 1400 quanta a pixel, image intensifiers and flat
panels. The images come from this project's own renderer; `distalock bench independent_images` makes the same table
from others' images.

Errors are the worse hole's, in the guide's frame, over the images that a method accepts. `paper` is its chain whole
(`--method fronto-parallel`); `paper's rule` takes our calibration, guide and search for the nail, and of the paper only
that round holes have the camera's axis. Neither predicts its error, so the product never moves a robot by them; here
they are taken at their word whenever the holes look round. Wrong: off by more than {entry:g} mm or {axis:g}°.

"""
_PEER = """
Normalised: error over predicted standard uncertainty, rms over all holes; 1 is right. The peer is OpenCV's
`HoughCircles` over the same image in the same process ({peer:.3f} s here). Naming the ring's balls is not counted for
the paper; the rule's time is what it adds to the model's.

"""
_LIMIT = """## Cramér-Rao limit with texture

Worked out for {count} of the scenes (`benchmarks/limits/cramer_rao.py` says what is known and what is not,
[limit.md](limit.md) what it is made of). It is the nail's alone: guide and calibration are taken to be without error.
"""


def report(rows: Sequence[SceneRow], revisions: Sequence[str], pictures: Sequence[str]) -> str:
    """The whole page, as Markdown."""
    head = _HEAD.format(
        count=len(rows),
        seed=min(row.seed for row in rows),
        revisions=", ".join(revisions),
        entry=LARGEST_ENTRY_ERROR_MM,
        axis=LARGEST_AXIS_ERROR_DEG,
    )
    tables = head + methods_table({m: outcomes(rows, m) for m in Compared}, [row.peer_seconds for row in rows])
    shown = "\n## Pictures\n\n" + "\n\n".join(f"![{name}]({name})" for name in pictures) + "\n"
    parts = [*_refusals(rows), *_capture(rows), *_limits(rows), *_strata(rows)]
    return tables + "\n".join(parts) + shown


def outcomes(rows: Iterable[SceneRow], method: Compared) -> list[Outcome]:
    """What a method made of the scenes; where it could not begin there is nothing."""
    return [outcome for row in rows if (outcome := _outcome(row, method)) is not None]


def _outcome(row: SceneRow, method: Compared) -> Outcome | None:
    match method:
        case Compared.MODEL:
            return row.model
        case Compared.PAPER:
            return row.paper
        case Compared.PAPER_RULE:
            return row.paper_rule
        case _:
            assert_never(method)


def methods_table(by_method: Mapping[Compared, Sequence[Outcome]], peer_seconds: Sequence[float]) -> str:
    """One line per method, over the same images, with the time of the peer on each."""
    lines = [
        "| method | accepted | wrong | entry mm | axis ° | normalised entry, axis | s | over the peer's |",
        "|---|---|---|---|---|---|---|---|",
    ]
    peer = float(np.median(peer_seconds))
    for method, all_of_it in by_method.items():
        accepted = [one for one in all_of_it if one.accepted]
        seconds = float(np.median([one.seconds for one in all_of_it])) if all_of_it else float("nan")
        lines.append(
            f"| {method} | {len(accepted)} of {len(peer_seconds)} | {sum(one.off for one in accepted)} "
            f"| {_errors(accepted)} | {_normalised(accepted)} | {seconds:.2f} | {seconds / peer:.0f} |"
        )
    return "\n".join([*lines, ""]) + _PEER.format(peer=peer)


def _errors(accepted: Sequence[Outcome]) -> str:
    """Two cells: median, 95 % and worst of both errors."""
    entry, axis = ([getattr(one, name) for one in accepted] for name in ("entry_mm", "axis_deg"))
    return f"{text_of(quantiles(entry))} | {text_of(quantiles(axis))}"


def _normalised(accepted: Sequence[Outcome]) -> str:
    entry, axis = normalised(accepted)
    return "-" if np.isnan(entry) else f"{entry:.2f}, {axis:.2f}"


def _refusals(rows: Sequence[SceneRow]) -> list[str]:
    counts = {
        method: Counter(code for outcome in outcomes(rows, method) for code in outcome.codes) for method in Compared
    }
    codes = sorted({code for counter in counts.values() for code in counter})
    lines = ["## Refusals by code", "", f"| code | {' | '.join(Compared)} |", "|---|---|---|---|"]
    lines += [f"| {code} | {' | '.join(str(counts[method][code]) for method in Compared)} |" for code in codes]
    return [*lines, ""]


def _capture(rows: Sequence[SceneRow]) -> list[str]:
    lines = [
        "## Capture",
        "",
        "Where the search for the nail ends before anything is refused, from no starting guess.",
        "",
        "| search ended | scenes | of them refused | of them accepted |",
        "|---|---|---|---|",
    ]
    for capture in Capture:
        own = [row for row in rows if row.capture is capture]
        accepted = sum(row.model.accepted for row in own)
        lines.append(f"| {capture} | {len(own)} | {len(own) - accepted} | {accepted} |")
    return [*lines, ""]


def _limits(rows: Sequence[SceneRow]) -> list[str]:
    """Errors of accepted scenes over the limit."""
    limited = [row for row in rows if row.limits is not None]
    ratios = limit_ratios(limited)
    if not ratios:
        return []
    pairs = [pair for row in limited if row.model.accepted for pair in _holes_and_limits(row)]
    predicted = [hole.axis_sd_deg / limit.axis_deg for hole, limit in pairs if hole.axis_sd_deg is not None]
    low, high = np.percentile(_resampled(ratios), [2.5, 97.5])
    lines = [
        "| | axis |",
        "|---|---|",
        f"| limit: median / 95 % / worst | {text_of(quantiles(limit.axis_deg for _, limit in pairs))}° |",
        f"| error over limit, rms over {len(ratios)} accepted scenes | {root_mean_square(ratios):.2f} |",
        f"| 95 % of what other scenes would give | {low:.2f} to {high:.2f} |",
        f"| predicted uncertainty over limit, median | {np.median(predicted):.2f} |",
    ]
    return [_LIMIT.format(count=len(limited)), *lines, ""]


def _holes_and_limits(row: SceneRow) -> list[tuple[HoleError, AxisLimit]]:
    return list(zip(row.model.holes or (), row.limits or (), strict=True))


def limit_ratios(rows: Sequence[SceneRow]) -> list[float]:
    """Axis error over limit of accepted scenes for which the limit was worked out: rms over the holes of each."""
    accepted = [row for row in rows if row.limits is not None and row.model.accepted]
    return [root_mean_square(h.axis_deg / limit.axis_deg for h, limit in _holes_and_limits(row)) for row in accepted]


def _resampled(ratios: Sequence[float]) -> list[float]:
    rng = np.random.default_rng(0)
    values = np.array(ratios)
    return [root_mean_square(rng.choice(values, len(values))) for _ in range(500)]


def _strata(rows: Sequence[SceneRow]) -> list[str]:
    lines = [
        "## What makes it hard",
        "",
        "Our own method; `paper` and `rule`: how many views those accept, with the median of their axis errors.",
        "",
        "| | scenes | accepted | entry mm | axis ° | normalised entry, axis | paper | rule |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for title, strata in STRATA.items():
        lines.append(f"| **{title}** | | | | | | | |")
        lines += [_stratum(name, [row for row in rows if member(row)]) for name, member in strata]
    return [*lines, ""]


def _stratum(name: str, rows: Sequence[SceneRow]) -> str:
    accepted = [row.model for row in rows if row.model.accepted]
    others = []
    for method in (Compared.PAPER, Compared.PAPER_RULE):
        own = [one for one in outcomes(rows, method) if one.accepted]
        others.append(f"{len(own)}: {quantiles(one.axis_deg for one in own)[0]:.2f}°" if own else "0")
    return (
        f"| {name} | {len(rows)} | {len(accepted)} | {_errors(accepted)} | {_normalised(accepted)} "
        f"| {others[0]} | {others[1]} |"
    )
