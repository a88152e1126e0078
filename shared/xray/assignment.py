"""Which of several takes what only one can have."""

import numpy as np
from numpy.typing import NDArray


def nearest_to_each(target: NDArray[np.int64], distance: NDArray[np.float64]) -> NDArray[np.int64]:
    """Of N claims, each to a target at a distance, the nearest to each target: their places, in the targets' order.

    Of equally near ones the first.
    """
    if not len(target):
        return np.zeros(0, dtype=np.int64)
    claims = np.argsort(distance, kind="stable")[::-1]
    holder = np.full(int(target.max()) + 1, -1, dtype=np.int64)
    # of several values for one place, the last stays
    holder[target[claims]] = claims
    return holder[holder >= 0]
