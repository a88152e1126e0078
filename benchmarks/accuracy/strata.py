"""The kinds of scenes among which the tables divide: what may make an image hard."""

from collections.abc import Callable

import numpy as np

from benchmarks.accuracy.localised_scenes import SceneRow

Stratum = tuple[str, Callable[[SceneRow], bool]]
# Share of mineral times contrast of the texture: about the middle of what the scenes have.
_MIDDLE_TEXTURE = 0.052
_TILTS_DEG = ((0, 2), (2, 4), (4, 6), (6, 8))
_DOSES = ((200, 400), (400, 700), (700, 1400))
_DIAMETERS_MM = (("9-10 mm", 9.0, 10.25), ("10.5-11.5 mm", 10.25, 11.75), ("12-13 mm", 11.75, 14.0))


def _tilted(low: float, high: float) -> Callable[[SceneRow], bool]:
    return lambda row: low <= row.kind.tilt_deg < high


def _dosed(low: float, high: float) -> Callable[[SceneRow], bool]:
    return lambda row: low <= row.kind.photons_per_px < high


def _thick(low: float, high: float) -> Callable[[SceneRow], bool]:
    return lambda row: low <= row.kind.diameter_mm < high


def _texture(row: SceneRow) -> float:
    return row.kind.texture_contrast * row.kind.spongy_share


STRATA: dict[str, tuple[Stratum, ...]] = {
    "tilt": (*((f"{a}-{b}°", _tilted(a, b)) for a, b in _TILTS_DEG), ("8° and more", _tilted(8.0, np.inf))),
    "dose, quanta a pixel": tuple((f"{a}-{b}", _dosed(a, b)) for a, b in _DOSES),
    "balls over the holes": (
        ("none", lambda row: row.kind.balls_on_holes == 0),
        ("1 or 2", lambda row: 1 <= row.kind.balls_on_holes <= 2),
        ("3 and more", lambda row: row.kind.balls_on_holes >= 3),
    ),
    "guide balls covered": (
        ("below 25 %", lambda row: row.kind.guide_balls_lost < 0.25),
        ("25-50 %", lambda row: 0.25 <= row.kind.guide_balls_lost < 0.5),
        ("50 % and more", lambda row: row.kind.guide_balls_lost >= 0.5),
    ),
    "nail": (
        ("steel", lambda row: row.kind.material == "steel"),
        ("Ti6Al4V", lambda row: row.kind.material != "steel"),
        ("solid", lambda row: not row.kind.cannulated),
        ("cannulated", lambda row: row.kind.cannulated),
    ),
    "nail's diameter": tuple((name, _thick(a, b)) for name, a, b in _DIAMETERS_MM),
    "bone's texture": (
        ("weaker half", lambda row: _texture(row) < _MIDDLE_TEXTURE),
        ("stronger half", lambda row: _texture(row) >= _MIDDLE_TEXTURE),
    ),
    "distortion": (
        ("flat panel", lambda row: row.kind.distortion_px == 0.0),
        ("below 23 px", lambda row: 0.0 < row.kind.distortion_px < 23.0),
        ("23 px and more", lambda row: row.kind.distortion_px >= 23.0),
    ),
}
