"""Two kinds at once: which ones meet on a seed, and what becomes of the other kind's scene."""

from pathlib import Path

import numpy as np

from benchmarks.robustness import combined, processing
from benchmarks.robustness.kinds import CONTROL
from benchmarks.robustness.scene import ImageFolder, RobustScene
from services.imaging.core.nominal import NominalGeometry

_SIZE_PX = 64
_DRAWN_BEFORE = "size_px"
_FIT, _JUDGED = range(60_000, 60_040), range(65_000, 65_040)


def small_scene(kind: str, seed: int) -> RobustScene:
    """A few grey values in the place of a rendered image."""
    pixels = np.random.default_rng(seed).integers(2_000, 60_000, (_SIZE_PX, _SIZE_PX)).astype(np.uint16)
    middle = (0.5 * _SIZE_PX, 0.5 * _SIZE_PX)
    return RobustScene(kind, seed, {_DRAWN_BEFORE: _SIZE_PX}, pixels, NominalGeometry(1000.0, 0.2), (), middle)


def twice(folder: Path, seed: int) -> RobustScene:
    images = ImageFolder(folder)
    for name in (CONTROL, "noise", "lag"):
        images.scene(name, seed, small_scene)
    return combined.processed_twice(seed, images)


def test_seeds_that_fit_meet_no_kind_that_is_held_out(tmp_path: Path) -> None:
    drawn = [twice(tmp_path, seed).drawn for seed in _FIT]
    met = {str(one[name]) for one in drawn for name in ("other", "operator")}
    assert len(met) > 10
    assert not met & set(processing.HELD_OUT)


def test_seeds_that_judge_meet_all_kinds(tmp_path: Path) -> None:
    drawn = [twice(tmp_path, seed).drawn for seed in _JUDGED]
    assert {str(one["operator"]) for one in drawn} & set(processing.HELD_OUT)
    assert {str(one["other"]) for one in drawn} & set(processing.HELD_OUT)


def test_a_combined_scene_keeps_what_the_other_kind_drew_and_changes_its_image(tmp_path: Path) -> None:
    images = ImageFolder(tmp_path)
    before = images.scene("thing_on_bend", _FIT[0], small_scene)
    scene = combined.processed_thing_on_bend(_FIT[0], images)
    assert scene.kind == "processed_thing_on_bend"
    assert scene.drawn[_DRAWN_BEFORE] == _SIZE_PX
    assert not np.array_equal(scene.pixels, before.pixels)
    again = combined.processed_thing_on_bend(_FIT[0], images)
    assert np.array_equal(scene.pixels, again.pixels)
