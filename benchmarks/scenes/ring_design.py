"""Design the default calibration ring.

`python -m benchmarks.scenes.ring_design` writes shared/parts/catalogue/ring-120.json.

Wanted: 120 balls on two plates 76 mm apart; no two shadows touch, wherever the focal spot wanders; each plate covers
the whole circle, so that source and distortion can be told apart everywhere; and no turned, mirrored or shifted copy of
the pattern looks like the pattern. Points are thrown at random with a least distance between shadows (seeded), and
spread over the plates by taking the farthest point in turn.
"""

import json

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.common.places import CATALOGUE

Array = NDArray[np.float64]

SEED = 20260117
BALLS, FAR_BALLS = 120, 46
SHADOW_RADIUS_MM = 105.0
LEAST_DISTANCE_MM = 12.5
FAR_PLATE_MM = -76.0
SOURCE_MM = 975.0
NEAR_DIAMETER_MM, FAR_DIAMETER_MM = 2.0, 3.0
PLATE = {"radius_mm": 118.0, "thickness_mm": 3.0}
FILE = CATALOGUE / "ring-120.json"


def main() -> None:
    rng = np.random.default_rng(SEED)
    shadows = throw(rng)
    far = farthest_in_turn(shadows, FAR_BALLS)
    positions = balls(shadows, far)
    FILE.write_text(as_json(positions))
    alike = most_alike(shadows)
    print(f"{FILE.name}: {len(shadows)} balls, {len(far)} of them at z = {FAR_PLATE_MM:g} mm, seed {SEED}")
    print(f"nearest shadows {nearest(shadows):.1f} mm apart; {alike} of {BALLS} fit the most similar other placing")


def throw(rng: np.random.Generator) -> Array:
    """Random points in a circle that keep their distance, shape (120, 2), in mm."""
    points: list[Array] = []
    while len(points) < BALLS:
        point = SHADOW_RADIUS_MM * np.sqrt(rng.random()) * unit(2.0 * np.pi * rng.random())
        if all(np.hypot(*(point - other)) >= LEAST_DISTANCE_MM for other in points):
            points.append(point)
    return np.array(points)


def unit(angle_rad: float) -> Array:
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def farthest_in_turn(points: Array, count: int) -> list[int]:
    """Indices of points, each the farthest from those before it."""
    chosen = [int(np.argmin(np.hypot(*points.T)))]
    while len(chosen) < count:
        distance = np.hypot(*(points[:, None] - points[chosen][None]).transpose(2, 0, 1)).min(axis=1)
        chosen.append(int(np.argmax(distance)))
    return chosen


def balls(shadows: Array, far: list[int]) -> Array:
    """Positions and diameters, shape (120, 4): those of the far plate drawn in, so that their shadows fall in place."""
    height = np.zeros(len(shadows))
    height[far] = FAR_PLATE_MM
    place = shadows * ((SOURCE_MM + height) / SOURCE_MM)[:, None]
    diameter = np.where(height == 0.0, NEAR_DIAMETER_MM, FAR_DIAMETER_MM)
    return np.round(np.column_stack([place, height, diameter]), 3)


def nearest(points: Array) -> float:
    distance, _ = cKDTree(points).query(points, k=2)
    return float(np.asarray(distance)[:, 1].min())


def most_alike(shadows: Array, tolerance_mm: float = 1.5) -> int:
    """Most shadows that another placing of the same pattern explains: each pair laid on each pair, mirrored or not."""
    tree = cKDTree(shadows)
    pattern = shadows @ np.array([1.0, 1.0j])
    pairs = np.array([(a, b) for a in range(BALLS) for b in range(BALLS) if 0 < abs(pattern[a] - pattern[b]) < 30.0])
    most = 0
    for flipped in (pattern, np.conj(pattern)):
        for a, b in pairs:
            factor = (pattern[b] - pattern[a]) / (flipped[pairs[:, 1]] - flipped[pairs[:, 0]])
            for k in np.flatnonzero(np.abs(np.abs(factor) - 1.0) < 0.05):
                if flipped is pattern and tuple(pairs[k]) == (a, b):
                    continue
                placed = factor[k] * (flipped - flipped[pairs[k, 0]]) + pattern[a]
                distance, index = tree.query(np.column_stack([placed.real, placed.imag]))
                close = np.asarray(distance) < tolerance_mm
                most = max(most, int(np.count_nonzero(close & (np.asarray(index) != np.arange(BALLS)))))
    return most


def as_json(positions: Array) -> str:
    rows = [
        {"id": f"R{i:03d}", "position_mm": [float(v) for v in row[:3]], "diameter_mm": float(row[3])}
        for i, row in enumerate(positions)
    ]
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    plates = json.dumps([{"z_mm": 0.0, **PLATE}, {"z_mm": FAR_PLATE_MM, **PLATE}])
    return (
        '{\n "schema": "distalock/ring/1",\n "units": "mm",\n'
        f' "ball_count": {BALLS},\n "plates": {plates},\n "balls": [\n  {lines}\n ]\n}}\n'
    )


if __name__ == "__main__":
    main()
