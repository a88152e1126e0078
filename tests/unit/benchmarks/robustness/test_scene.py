"""Rendered images on file, and rows made from them."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from benchmarks.robustness.all_kinds import KINDS
from benchmarks.robustness.command import RobustnessBench, run_bench
from benchmarks.robustness.kinds import CONTROL, Kind, rendered_kind
from benchmarks.robustness.processing import processed_scene
from benchmarks.robustness.rows import Row, key_of, kind_row
from benchmarks.robustness.scene import ImageFolder, RobustScene
from benchmarks.robustness.tone import black_cut_off, half_size, jpeg
from services.imaging.core.nominal import NominalGeometry
from simulation.render.truth import HoleTruth

SEED = 60_007


def blank_scene(kind: str, seed: int) -> RobustScene:
    """A slope of grey values, which has no ring."""
    pixels = np.linspace(100, 60_000, 64 * 64).reshape(64, 64).astype(np.uint16)
    hole = HoleTruth("distal", np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 1.0]), 4.5)
    return RobustScene(kind, seed, {"a": 0.1}, pixels, NominalGeometry(950.0, 0.24), (hole,), (30.0, 31.0))


def refuse(kind: str, seed: int) -> RobustScene:
    pytest.fail(f"{kind} {seed} was rendered again")


def test_a_scene_on_file_is_not_rendered_again(tmp_path: Path) -> None:
    folder = ImageFolder(tmp_path)
    first = folder.scene("lag", SEED, blank_scene)
    again = folder.scene("lag", SEED, refuse)
    for found in (first, again):
        made = blank_scene("lag", SEED)
        assert np.array_equal(found.pixels, made.pixels)
        assert found.pixels.dtype == np.uint16
        assert (found.drawn, found.nominal, found.middle_px) == (made.drawn, made.nominal, made.middle_px)
        assert np.array_equal(found.holes[0].entry_point_guide_mm, made.holes[0].entry_point_guide_mm)
        assert found.holes[0].tilt_to_ray_deg == 4.5


def test_processing_takes_the_control_from_file_and_keeps_its_truth(tmp_path: Path) -> None:
    folder = ImageFolder(tmp_path)
    folder.scene(CONTROL, SEED, blank_scene)
    half = processed_scene(half_size, "half_size", SEED, folder)
    assert half.pixels.shape == (32, 32)
    assert half.nominal == NominalGeometry(950.0, 0.48)
    assert half.middle_px == (15.0, 15.5)
    assert processed_scene(jpeg, "jpeg", SEED, folder).pixels.dtype == np.uint8
    cut = processed_scene(black_cut_off, "black_cut_off", SEED, folder)
    assert cut.pixels.dtype == np.uint16
    assert cut.holes[0].id == "distal"


def test_a_row_carries_the_controls_verdict_and_its_own(tmp_path: Path) -> None:
    kinds = (rendered_kind(blank_scene, "blank"),)
    row = kind_row(kinds, {SEED: ()}, tmp_path, key_of("blank", SEED))
    assert row.codes
    assert row.usable
    assert not row.accepted
    assert row.drawn == {"a": 0.1}


def broken(seed: int, images: ImageFolder) -> RobustScene:
    """A scene whose truth names no hole of the part: scoring it raises."""
    scene = images.scene("broken", seed, blank_scene)
    return RobustScene(scene.kind, seed, {}, scene.pixels[:, :0], scene.nominal, scene.holes, scene.middle_px)


BROKEN = Kind("broken", "Its image is empty.", partial(broken))


def test_a_crash_is_a_code_of_its_own() -> None:
    row = kind_row((BROKEN,), {}, None, key_of("broken", SEED))
    assert row.codes[0].startswith("crashed: ")
    assert row.crashed
    assert not row.accepted


@pytest.mark.parametrize(("codes", "status"), [(("crashed: ValueError: of nothing",), 1), (("ring_not_found",), 0)])
def test_a_crash_fails_the_bench(tmp_path: Path, codes: tuple[str, ...], status: int) -> None:
    """Of rows on file, too: a run that goes on from them shows what failed before."""
    file = tmp_path / "rows.jsonl"
    with file.open("w") as stream:
        for kind in (CONTROL, "broken"):
            row = TypeAdapter(Row).dump_python(Row(kind, 65_000, {}, (), codes, None, 1.0))
            stream.write(json.dumps({"key": key_of(kind, 65_000), "revision": "", "row": row}) + "\n")
    arguments = ["--kind", "broken", "--count", "1", "--rows", str(file)]
    assert run_bench(RobustnessBench("broken", "nothing but crashes", (BROKEN,)), arguments) == status


def test_every_kind_says_what_it_does() -> None:
    assert [kind.name for kind in KINDS.values() if not kind.what.endswith(".")] == []
