"""Time of one image: what one core means, and what the table says."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from benchmarks.accuracy.image_time import on_one_core, report


def test_one_core_is_one_for_every_thread_and_only_for_the_while() -> None:
    with ThreadPoolExecutor(max_workers=1) as pool:
        before = pool.submit(os.sched_getaffinity, 0).result()
        with on_one_core():
            there = pool.submit(os.sched_getaffinity, 0).result()
            assert there == os.sched_getaffinity(0) == {min(before)}
        assert pool.submit(os.sched_getaffinity, 0).result() == os.sched_getaffinity(0) == before


def test_the_table_has_medians_and_their_ratio_to_the_peer() -> None:
    both = np.array([[0.1, 0.1, 0.4, 0.0, 0.6], [0.1, 0.2, 0.5, 0.0, 0.8], [0.2, 0.2, 0.5, 0.1, 1.0]])
    text = report(both, 1.5 * both, np.array([0.01, 0.02, 0.02]))
    assert "| whole image | 800 | 1200 | 75.0 |" in text
    assert "| HoughCircles | | 20 | 1 |" in text
    assert "one core took 1.50 times as long" in text
