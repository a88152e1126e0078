"""What the display and the detector's blur do to the signal, and derivatives of the signal by what they do."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from simulation.render.display import curve
from simulation.scenario.values import Scenario

Floats = NDArray[np.float64]
_LOG_STEP, _SHARE_STEP = 0.04, 0.02


@dataclass(frozen=True, slots=True)
class Blur:
    """The detector's blur without its halo: a narrow Gaussian, and a share that goes into a wide one."""

    narrow_px: float
    wide_px: float
    wide_share: float

    def of(self, image: Floats) -> Floats:
        """The image after it."""
        narrow, wide = (
            cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
            for sigma in (self.narrow_px, self.wide_px)
        )
        return np.asarray((1.0 - self.wide_share) * narrow + self.wide_share * wide)


def _blur_of(scenario: Scenario) -> Blur:
    e = scenario.exposure
    return Blur(e.blur_px, e.tail_px, e.tail_share)


def blurred(scenario: Scenario, image: Floats) -> Floats:
    """The image after the detector's blur without its halo."""
    kept = 1.0 - scenario.exposure.glare_share
    return np.asarray(kept * _blur_of(scenario).of(np.ascontiguousarray(image, dtype=np.float64)))


def averaged(scenario: Scenario, image: Floats) -> Floats:
    """Mean over the reach of the detector's blur."""
    return blurred(scenario, image) / (1.0 - scenario.exposure.glare_share)


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The display's curve at the expected signal, shape of the image."""

    scenario: Scenario
    seen: NDArray[np.float32]
    window: NDArray[np.float32]

    def value(self) -> NDArray[np.float32]:
        """Signal relative to full scale."""
        display = self.scenario.display
        white = float(np.percentile(self.seen[self.window > 0.5], display.white_percentile))
        return np.asarray(self.seen * (display.white_level / white), dtype=np.float32)

    def unclipped(self) -> NDArray[np.bool_]:
        """Where the grey value still tells the signal."""
        return np.asarray((self.value() < 1.0) & (self.window > 0.5))

    def slope(self) -> Floats:
        """Derivative of the grey value by the signal."""
        value = np.clip(self.value(), 1e-4, 1.0)
        step = np.float32(1e-2) * value
        sides = [curve(self.scenario.display, value + k * step).astype(np.float64) for k in (0.5, -0.5)]
        return np.asarray((sides[0] - sides[1]) / step * (self.value() / np.maximum(self.seen, 1e-9)))


def derivatives_after_tracing(
    scenario: Scenario,
    signal: NDArray[np.float32],
    seen: NDArray[np.float32],
    where: tuple[slice, slice],
    shown: Shown,
) -> Iterator[Floats]:
    """Of the signal by the blur (3), a linear floor (3), the display's curve (3) and its edge enhancement (2)."""
    around = np.ascontiguousarray(signal, dtype=np.float64)
    for more, less, step in _blurs_to_either_side(_blur_of(scenario)):
        yield ((1.0 - scenario.exposure.glare_share) * (more.of(around) - less.of(around)) / step)[where]
    level = float(np.median(seen))
    shape = seen[where].shape
    yield np.full(shape, level)
    yield np.broadcast_to(np.linspace(-level, level, shape[1])[None, :], shape)
    yield np.broadcast_to(np.linspace(-level, level, shape[0])[:, None], shape)
    display, value, slope = scenario.display, np.clip(shown.value(), 1e-4, 1.0), shown.slope()
    for name in ("gamma", "toe", "shoulder"):
        sides = [
            curve(replace(display, **{name: getattr(display, name) + s * _SHARE_STEP}), value).astype(np.float64)
            for s in (0.5, -0.5)
        ]
        yield ((sides[0] - sides[1]) / _SHARE_STEP / slope)[where]
    grey = curve(display, value).astype(np.float64)
    wide = [cv2.GaussianBlur(grey, (0, 0), display.sharpening_px * np.exp(s)) for s in (0.0, 0.02, -0.02)]
    yield (_unsharpened(scenario, np.asarray(grey - wide[0])) / slope)[where]
    yield (
        _unsharpened(scenario, np.asarray(-max(display.sharpening, 0.05) * (wide[1] - wide[2]) / 0.04, np.float64))
        / slope
    )[where]


def _blurs_to_either_side(blur: Blur) -> Iterator[tuple[Blur, Blur, float]]:
    """Blurs half a step to either side and the step: in log width, in the wide one's share, in its own log width."""
    step = _LOG_STEP
    wider, narrower = float(np.exp(0.5 * step)), float(np.exp(-0.5 * step))
    yield _widened(blur, wider, wider), _widened(blur, narrower, narrower), step
    more, less = (replace(blur, wide_share=blur.wide_share + s * _SHARE_STEP) for s in (0.5, -0.5))
    yield more, less, _SHARE_STEP
    yield _widened(blur, 1.0, wider), _widened(blur, 1.0, narrower), step


def _widened(blur: Blur, narrow_by: float, wide_by: float) -> Blur:
    return replace(blur, narrow_px=narrow_by * blur.narrow_px, wide_px=wide_by * blur.wide_px)


def _unsharpened(scenario: Scenario, image: Floats) -> Floats:
    """Undo the edge enhancement `x + a (x - blurred x)`: iterated, as a / (1 + a) is below one."""
    a, width = scenario.display.sharpening, scenario.display.sharpening_px
    out = image / (1.0 + a)
    for _ in range(12):
        out = (image + a * cv2.GaussianBlur(out, (0, 0), width)) / (1.0 + a)
    return np.asarray(out)
