"""Operators on grey values: each does what its name says, with parameters from its generator alone."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robustness import held_out, tone
from benchmarks.robustness.processing import dead_line, dead_pixels, vignetted
from benchmarks.robustness.tone import Operator

OPERATORS: tuple[Operator, ...] = (
    tone.black_cut_off,
    tone.white_cut_off,
    tone.gamma_curve,
    tone.s_curve,
    tone.local_contrast,
    tone.unsharp_mask,
    tone.multi_scale,
    tone.bilateral_filter,
    tone.non_local_means,
    tone.median_filter,
    tone.gaussian_blur,
    tone.jpeg,
    tone.monitor_chain,
    tone.half_size,
    tone.six_bits,
    dead_pixels,
    dead_line,
    vignetted,
    held_out.range_compression,
    held_out.local_normalisation,
    held_out.anisotropic_diffusion,
    held_out.wavelet_shrinkage,
    held_out.window_and_jpeg,
)
CURVES = (tone.gamma_curve, tone.s_curve, tone.white_cut_off)


def picture(size: int = 128) -> NDArray[np.float32]:
    """A smooth slope with noise and a dark bar, inside a black surround as an intensifier has it."""
    generator = np.random.default_rng(1)
    share = 0.3 + 0.5 * np.linspace(0.0, 1.0, size)[:, None] + 0.02 * generator.standard_normal((size, size))
    share[:, 50:70] *= 0.4
    share[:8] = 0.0
    return np.clip(share, 0.0, 1.0).astype(np.float32)


@pytest.mark.parametrize("operator", OPERATORS, ids=lambda one: one.__name__)
def test_an_operator_changes_the_image_within_its_scale_and_repeats_itself(operator: Operator) -> None:
    before = picture()
    first, again = (operator(before, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(first.share, again.share)
    assert first.drawn == again.drawn
    assert first.drawn
    assert 0.0 <= float(first.share.min()) < float(first.share.max()) <= 1.0
    assert np.array_equal(before, picture())
    assert first.share.shape != before.shape or not np.array_equal(first.share, before)


def test_black_cut_off_saturates_the_drawn_share_of_the_visible_field() -> None:
    before = picture()
    after = tone.black_cut_off(before, np.random.default_rng(3))
    visible = before > 0.0
    assert np.mean(after.share[visible] == 0.0) == pytest.approx(after.drawn["quantile"], abs=1e-3)
    assert after.share.max() == pytest.approx((before.max() - _black(before, after)) / (1.0 - _black(before, after)))


def _black(before: NDArray[np.float32], after: tone.Processed) -> float:
    return float(np.quantile(before[before > 0.0], float(after.drawn["quantile"])))


@pytest.mark.parametrize("curve", CURVES, ids=lambda one: one.__name__)
def test_curves_keep_the_order_of_grey_values(curve: Callable[..., tone.Processed]) -> None:
    ramp = np.linspace(0.0, 1.0, 257, dtype=np.float32)[None].repeat(4, axis=0)
    after = curve(ramp, np.random.default_rng(5)).share
    assert np.all(np.diff(after, axis=1) >= 0.0)
    assert after[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert after[0, -1] == pytest.approx(1.0, abs=1e-6)


def test_a_pyramid_with_unit_gains_would_give_the_image_back() -> None:
    class Unit(np.random.Generator):
        """Draws one always."""

        def uniform(self, *_: object, **__: object) -> object:  # type: ignore[override]
            return np.ones(5) if len(_) > 2 else 1.0

    before = picture()
    after = tone.multi_scale(before, Unit(np.random.PCG64(0)))
    assert float(np.abs(after.share - before).max()) < 1e-5


def test_six_bits_have_64_grey_values() -> None:
    assert len(np.unique(tone.six_bits(picture(), np.random.default_rng(0)).share)) <= 64


def test_one_pixel_in_a_thousand_is_dead() -> None:
    before = np.full((512, 512), 0.5, dtype=np.float32)
    after = dead_pixels(before, np.random.default_rng(2)).share
    assert np.mean(after != before) == pytest.approx(1e-3, rel=0.2)


def test_one_line_is_dead() -> None:
    before = np.full((64, 64), 0.5, dtype=np.float32)
    after = dead_line(before, np.random.default_rng(2))
    rows, columns = np.nonzero(after.share != before)
    assert len(rows) == 64
    assert len(set(rows if after.drawn["along"] == "row" else columns)) == 1


@pytest.mark.parametrize("smoother", [held_out.anisotropic_diffusion, held_out.wavelet_shrinkage])
def test_edge_preserving_filters_lower_the_noise_and_keep_the_edge(smoother: Operator) -> None:
    before = picture()
    after = smoother(before, np.random.default_rng(7)).share
    noise = [np.std(np.diff(one[80:, 100:], axis=1)) for one in (before, after)]
    edge = [np.mean(one[20:, 72:76]) - np.mean(one[20:, 64:68]) for one in (before, after)]
    assert noise[1] < 0.8 * noise[0]
    assert edge[1] > 0.9 * edge[0]
