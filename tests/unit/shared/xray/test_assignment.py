"""Which of several takes what only one can have."""

import numpy as np

from shared.xray.assignment import nearest_to_each


def test_the_nearest_takes_each_target_and_the_first_of_equals() -> None:
    target = np.array([7, 2, 7, 2, 0, 7])
    distance = np.array([3.0, 1.0, 2.0, 1.0, 5.0, 9.0])
    assert nearest_to_each(target, distance).tolist() == [4, 1, 2]


def test_it_agrees_with_looking_at_every_target() -> None:
    rng = np.random.default_rng(1)
    target, distance = rng.integers(0, 20, 60), rng.integers(0, 9, 60).astype(float)
    expected = [min(np.flatnonzero(target == t), key=lambda n: distance[n]) for t in np.unique(target)]
    assert nearest_to_each(target, distance).tolist() == expected


def test_nobody_takes_nothing() -> None:
    assert len(nearest_to_each(np.zeros(0, dtype=np.int64), np.zeros(0))) == 0
