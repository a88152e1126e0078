"""Numbers that stand for many: quantiles, their text, and the root mean square."""

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

Quantiles: TypeAlias = tuple[float, float, float]


def quantiles(values: Iterable[float | None]) -> Quantiles:
    """Median, 95 % and worst; NaN of none. What is None is left out."""
    known = [value for value in values if value is not None]
    if not known:
        return (float("nan"),) * 3
    return float(np.median(known)), float(np.percentile(known, 95)), float(np.max(known))


def text_of(found: Quantiles, digits: int = 3) -> str:
    """The three beside one another; a dash where there is none."""
    return "-" if np.isnan(found[0]) else " / ".join(f"{value:.{digits}f}" for value in found)


def root_mean_square(values: Iterable[float]) -> float:
    """Of any number of values; NaN of none."""
    array = np.array(list(values))
    return float(np.sqrt(np.mean(array**2))) if len(array) else float("nan")
