"""Scenarios for tests: small images and few balls, so that they are quick; parts are not the catalogue's."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from shared.geometry.parts import BallPattern, GuidePart, NailPart, Plate, RingPart
from shared.parts.files import guide_from_json, nail_from_json
from simulation.scenario.files import ScenarioFile
from simulation.scenario.imaging_values import Display, FlatPanel
from simulation.scenario.sampling import scenario_from_file
from simulation.scenario.values import MountKind, Parts, Scenario

UP = [0.0, 0.0, 1.0]
PLAIN_DISPLAY = Display(
    quarter_turns=0,
    mirrored=False,
    gamma=1.0,
    toe=0.0,
    shoulder=0.0,
    white_percentile=90.0,
    white_level=0.9,
    sharpening=0.0,
    sharpening_px=2.0,
    bits=16,
)


def ring(ball_positions: list[list[float]] | None = None) -> RingPart:
    """A ring with a few balls of 3 mm and two plates."""
    positions = ball_positions or [[40.0, 10.0, 0.0], [-50.0, 20.0, 0.0], [10.0, -60.0, -76.0], [-30.0, -45.0, -76.0]]
    balls = BallPattern(
        tuple(f"R{i}" for i in range(len(positions))), np.array(positions), np.full(len(positions), 3.0)
    )
    return RingPart(balls, tuple(Plate(z, 118.0, 3.0) for z in (0.0, -76.0)), "0" * 64)


def guide() -> GuidePart:
    """A block of 55 x 40 x 15 mm with two holes of 5 mm, 30 mm apart, and four balls of 2 mm."""
    corners = [[-22.0, 16.0, -10.0], [22.0, 16.0, 10.0], [22.0, -16.0, -10.0], [-22.0, -13.0, 10.0]]
    content = {
        "schema": "distalock/guide/1",
        "units": "mm",
        "balls": [{"id": f"G{i}", "position_mm": p, "diameter_mm": 2.0} for i, p in enumerate(corners)],
        "holes": [
            {"id": "distal", "point_mm": [15.0, 0.0, 0.0], "direction": UP, "diameter_mm": 5.0},
            {"id": "proximal", "point_mm": [-15.0, 0.0, 0.0], "direction": UP, "diameter_mm": 5.0},
        ],
        "body": [{"centre_mm": [0.0, 0.0, 0.0], "size_mm": [55.0, 40.0, 15.0]}],
    }
    return guide_from_json(json.dumps(content).encode())


def nail(cannulation_mm: float = 0.0, hole_mm: float = 5.3) -> NailPart:
    """A titanium nail of 11 mm with two holes 30 mm apart."""
    content = {
        "schema": "distalock/nail/1",
        "units": "mm",
        "material": "Ti6Al4V",
        "diameter_mm": 11.0,
        "cannulation_diameter_mm": cannulation_mm,
        "tip_x_mm": 38.0,
        "holes": [
            {"id": "distal", "position_mm": [15.0, 0.0, 0.0], "direction": UP, "diameter_mm": hole_mm},
            {"id": "proximal", "position_mm": [-15.0, 0.0, 0.0], "direction": UP, "diameter_mm": hole_mm},
        ],
    }
    return nail_from_json(json.dumps(content).encode())


@cache
def scenario(seed: int = 1, size_px: int = 256) -> Scenario:
    """A scenario of `seed` with small parts, an image of `size_px` squared, no distortion and a plain display."""
    pixel_mm = 240.0 / size_px
    ranges = {"c_arm": {"size_px": size_px, "pixel_mm": [pixel_mm, pixel_mm]}}
    file = ScenarioFile(schema_name="distalock/scenario/1", seed=seed, mount=MountKind.BONE, ranges=ranges)
    sampled = scenario_from_file(file, Path())
    parts = Parts(ring(), guide(), nail(), sampled.parts.hexapod)
    return replace(sampled, parts=parts, detector=FlatPanel(), display=PLAIN_DISPLAY)
