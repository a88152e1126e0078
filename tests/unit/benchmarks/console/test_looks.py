"""Looks of a page: other letters are alike, a panel that is missing is not."""

from pathlib import Path

import numpy as np

from benchmarks.console.looks import LARGEST_DIFFERENCE, Look, difference, keep, kept


def page_with(panel: int, noise: int = 0) -> Look:
    look = np.full((100, 160), 20, dtype=np.uint8)
    look[30:60, 50:110] = panel
    source = np.random.default_rng(3)
    noisy = np.clip(look + source.integers(-noise, noise + 1, look.shape), 0, 255)
    return np.asarray(noisy, dtype=np.uint8)


def test_a_panel_that_is_missing_is_noticed_and_other_letters_are_not() -> None:
    assert difference(page_with(120), page_with(120, noise=40)) < LARGEST_DIFFERENCE
    assert difference(page_with(120), page_with(20)) > LARGEST_DIFFERENCE


def test_what_is_kept_is_the_same(tmp_path: Path) -> None:
    keep(page_with(90, noise=9), tmp_path / "look.png")
    assert difference(kept(tmp_path / "look.png"), page_with(90, noise=9)) == 0.0
