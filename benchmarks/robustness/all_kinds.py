"""Every kind by its name, to make and localise one scene by hand.

from benchmarks.robustness.all_kinds import make_scene
from benchmarks.robustness.rows import localised

scene = make_scene("retractor", 60003, Path("/tmp/images"))
codes, holes = localised(scene)  # from scene.pixels, scene.nominal and scene.parts, against scene.holes
"""

from collections.abc import Mapping
from pathlib import Path

from benchmarks.robustness import bent_nails, built_parts, combined, foreign_objects, processing
from benchmarks.robustness.kinds import CONTROL_KIND, Kind
from benchmarks.robustness.scene import ImageFolder, RobustScene

BENCHES = (processing.BENCH, foreign_objects.BENCH, bent_nails.BENCH, built_parts.BENCH, combined.BENCH)
KINDS: Mapping[str, Kind] = {kind.name: kind for kind in (CONTROL_KIND, *(k for b in BENCHES for k in b.kinds))}


def make_scene(kind: str, seed: int, images: Path | None = None) -> RobustScene:
    """One scene of a kind, from the folder of rendered images if it is there."""
    return KINDS[kind].make(seed, ImageFolder(images))
