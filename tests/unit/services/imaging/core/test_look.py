"""How balls are looked at, by the size of the pixels."""

import pytest

from services.imaging.core.look import look


def test_finer_pixels_need_wider_surroundings() -> None:
    usual, fine = look(0.4, 0.235), look(0.4, 0.1175)
    assert fine.reach_px == pytest.approx(2.0 * usual.reach_px)
    assert fine.blur_px == pytest.approx(2.0 * usual.blur_px)
    assert usual.drift_px == 0.4
    assert fine.drift_px == pytest.approx(0.8)


def test_coarser_pixels_do_not_need_narrower_ones() -> None:
    assert look(0.4, 0.4) == look(0.4, 0.235)


def test_how_clear_a_ball_must_be_can_be_said() -> None:
    assert look(0.4, 0.2).contrast_to_sd < look(0.4, 0.2, 8.0).contrast_to_sd == 8.0
