"""Compiled functions: the machine code is kept on disk and read again."""

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled


def _doubled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return 2.0 * values


def test_machine_code_on_disk_is_read_by_the_next_process() -> None:
    given = np.array([1.0, -2.5])
    assert np.array_equal(compiled(_doubled)(given), [2.0, -5.0])  # compiles where nothing is on disk yet
    again = compiled(_doubled)
    assert np.array_equal(again(given), [2.0, -5.0])
    assert sum(again.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]  # of numba's dispatcher
