"""Random rings, guides and nails of the kinds that the product is for, as part files: patterns that nobody tuned to."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes.ring_design import farthest_in_turn, throw

Array = NDArray[np.float64]

_RING_HEIGHT_MM = 76.0
_SOURCE_MM = 975.0
_LINE_MM, _CROSS_LINE_MM = (-26.0, 26.0), (-17.5, 17.5)
_LINE_GAPS_MM, _CROSS_LINE_GAPS_MM = (4.5, 9.5), (3.2, 7.0)
_BALLS_PER_LINE = 7
_NAIL_DIAMETER_MM, _HOLE_DIAMETER_MM, _SPACING_MM = (9.0, 13.0), (5.1, 6.4), (20.0, 35.0)
_CHAMFER_MM = (0.05, 0.4)
_WIDEST_HOLE = 0.58


def write_parts(folder: Path, rng: np.random.Generator) -> dict[str, str]:
    """Write one ring, guide and nail file; returns their names by kind, as a scenario file takes them."""
    parts = {"ring": random_ring(rng), "guide": random_guide(rng), "nail": random_nail(rng)}
    for kind, part in parts.items():
        (folder / f"{kind}.json").write_text(json.dumps(part))
    return {kind: f"{kind}.json" for kind in parts}


def random_ring(rng: np.random.Generator) -> dict[str, object]:
    """120 balls of 2 and 3 mm on two plates, thrown at random with a least distance between shadows."""
    shadows = throw(rng)
    height = np.zeros(len(shadows))
    height[farthest_in_turn(shadows, int(rng.integers(40, 61)))] = -_RING_HEIGHT_MM
    place = shadows * ((_SOURCE_MM + height) / _SOURCE_MM)[:, None]
    far_diameter, near_diameter = ((3.0, 2.0), (2.0, 3.0))[int(rng.integers(2))]
    diameter = np.where(height < 0.0, far_diameter, near_diameter)
    plates = [{"z_mm": z, "radius_mm": 118.0, "thickness_mm": 3.0} for z in (0.0, -_RING_HEIGHT_MM)]
    position = np.column_stack([place, height])
    return {"schema": "distalock/ring/1", "units": "mm", "balls": _balls("R", position, diameter), "plates": plates}


def random_guide(rng: np.random.Generator) -> dict[str, object]:
    """Two pairs of parallel lines of seven balls, unevenly spaced, across each other on planes 20 mm apart."""
    across, along = rng.uniform(15.0, 18.0), rng.uniform(22.0, 26.0)
    upper = [[x, side * across, -10.0] for side in (1.0, -1.0) for x in _uneven_line(rng, _LINE_MM, _LINE_GAPS_MM)]
    lower = [
        [side * along, y, 10.0] for side in (-1.0, 1.0) for y in _uneven_line(rng, _CROSS_LINE_MM, _CROSS_LINE_GAPS_MM)
    ]
    position = np.round(np.array(upper + lower), 1)
    spacing = float(rng.choice([30.0, 25.0, 35.0]))
    holes = [_guide_hole("distal", 0.5 * spacing), _guide_hole("proximal", -0.5 * spacing)]
    body = [
        {"centre_mm": [0.0, 0.0, 0.0], "size_mm": [55.0, 40.0, 15.0]},
        {"centre_mm": [0.0, 0.0, -10.0], "size_mm": [55.0, 40.0, 5.0]},
        {"centre_mm": [0.0, 0.0, 10.0], "size_mm": [55.0, 40.0, 5.0]},
    ]
    balls = _balls("G", position, np.full(len(position), 2.0))
    return {"schema": "distalock/guide/1", "units": "mm", "balls": balls, "holes": holes, "body": body}


def random_nail(rng: np.random.Generator) -> dict[str, object]:
    """The distal end of a femoral nail: steel or titanium, solid or cannulated, two holes."""
    diameter = float(np.round(rng.uniform(*_NAIL_DIAMETER_MM) * 2.0) / 2.0)
    widest = min(_HOLE_DIAMETER_MM[1], max(_WIDEST_HOLE * diameter, _HOLE_DIAMETER_MM[0] + 0.2))
    hole = float(np.round(rng.uniform(_HOLE_DIAMETER_MM[0], widest), 1))
    spacing = float(np.round(rng.uniform(*_SPACING_MM), 1))
    cannulation = 0.0 if rng.random() < 0.4 else float(np.round(rng.uniform(4.0, min(5.0, 0.45 * diameter)), 1))
    return {
        "schema": "distalock/nail/1",
        "units": "mm",
        "material": str(rng.choice(["steel", "Ti6Al4V"])),
        "diameter_mm": diameter,
        "cannulation_diameter_mm": cannulation,
        "tip_x_mm": float(np.round(0.5 * spacing + rng.uniform(12.0, 28.0), 1)),
        "holes": _nail_holes(spacing, hole, float(np.round(rng.uniform(*_CHAMFER_MM), 2))),
    }


def _uneven_line(rng: np.random.Generator, ends_mm: tuple[float, float], gaps_mm: tuple[float, float]) -> Array:
    """Places of seven balls along a line, shape (7,), in mm."""
    while True:
        gaps = rng.uniform(*gaps_mm, size=_BALLS_PER_LINE - 1)
        slack = (ends_mm[1] - ends_mm[0]) - gaps.sum()
        if slack >= 0.0:
            return np.asarray(ends_mm[0] + rng.uniform(0.0, slack) + np.concatenate([[0.0], np.cumsum(gaps)]))


def _balls(letter: str, position_mm: Array, diameter_mm: Array) -> list[dict[str, object]]:
    return [
        {"id": f"{letter}{i:03d}", "position_mm": np.round(p, 3).tolist(), "diameter_mm": float(d)}
        for i, (p, d) in enumerate(zip(position_mm, diameter_mm, strict=True))
    ]


def _guide_hole(name: str, x_mm: float) -> dict[str, object]:
    return {"id": name, "point_mm": [x_mm, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "diameter_mm": 5.0}


def _nail_holes(spacing_mm: float, diameter_mm: float, chamfer_mm: float) -> list[dict[str, object]]:
    shape = {"direction": [0.0, 0.0, 1.0], "diameter_mm": diameter_mm, "chamfer_mm": chamfer_mm}
    places = {"distal": 0.5 * spacing_mm, "proximal": -0.5 * spacing_mm}
    return [{"id": name, "position_mm": [x_mm, 0.0, 0.0], **shape} for name, x_mm in places.items()]
