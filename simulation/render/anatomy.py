"""Femur and thigh as shapes: a flaring tube closed by an ellipsoid, two condyles, each with a cortex, and the thigh."""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Bone
from shared.geometry.transform import Transform
from simulation.render import tracer
from simulation.render.rows import Row, Shapes, ellipsoid_row
from simulation.scenario.frames import Beam
from simulation.scenario.values import Anatomy

Floats = NDArray[np.float64]
_SHAFT_LENGTH_MM = 300.0
_END_LENGTH_MM = 17.0
_THIGH_HALF_LENGTH_MM = 700.0


def bone_shapes(anatomy: Anatomy, pose: Transform[Beam, Bone]) -> Shapes:
    """Everything of the patient that attenuates."""
    ellipsoids: list[Row] = [(tracer.THIGH, _thigh_row(anatomy, pose))]
    tubes: list[Row] = []
    for kind, cortex_shaft, cortex_end in (
        (tracer.BONE, 0.0, 0.0),
        (tracer.MARROW, anatomy.cortex_shaft_mm, anatomy.cortex_end_mm),
    ):
        tubes.append((kind, _tube_row(anatomy, cortex_shaft, cortex_end)))
        ellipsoids.append((kind, _end_row(anatomy, pose, cortex_end)))
        ellipsoids.extend((kind, row) for row in _condyle_rows(anatomy, pose, cortex_end))
    return Shapes(ellipsoids=tuple(ellipsoids), tubes=tuple(tubes))


def spongy_row(anatomy: Anatomy) -> Floats:
    """Mineral share of spongy bone, for the tracer: metaphysis, shaft, flare, texture contrast."""
    start, end = anatomy.flare_from_to_mm
    return np.array([anatomy.spongy_share, 0.02, start, end, anatomy.texture_contrast])


def _thigh_row(anatomy: Anatomy, pose: Transform[Beam, Bone]) -> Floats:
    centre = np.array([-0.4 * _THIGH_HALF_LENGTH_MM, *anatomy.thigh_centre_mm])
    return ellipsoid_row(pose, centre, np.array([_THIGH_HALF_LENGTH_MM, *anatomy.thigh_half_axes_mm]))


def _tube_row(anatomy: Anatomy, cortex_shaft_mm: float, cortex_end_mm: float) -> Floats:
    (ys, zs), (ye, ze) = anatomy.shaft_half_axes_mm, anatomy.flare_half_axes_mm
    start, end = anatomy.flare_from_to_mm
    return np.array(
        [
            start,
            end,
            ys - cortex_shaft_mm,
            ye - cortex_end_mm,
            zs - cortex_shaft_mm,
            ze - cortex_end_mm,
            -_SHAFT_LENGTH_MM,
            end,
        ]
    )


def _end_row(anatomy: Anatomy, pose: Transform[Beam, Bone], cortex_mm: float) -> Floats:
    """Ellipsoid that continues the tube where its flare ends, with the same section."""
    centre = np.array([anatomy.flare_from_to_mm[1], 0.0, 0.0])
    half_axes = np.array([_END_LENGTH_MM, *anatomy.flare_half_axes_mm]) - cortex_mm
    return ellipsoid_row(pose, centre, half_axes)


def _condyle_rows(anatomy: Anatomy, pose: Transform[Beam, Bone], cortex_mm: float) -> list[Floats]:
    rows = []
    for sign, x, back, half_axes in zip(
        (-1.0, 1.0),
        anatomy.condyle_centre_x_mm,
        anatomy.condyle_back_mm,
        anatomy.condyle_half_axes_mm,
        strict=True,
    ):
        centre = np.array([x, anatomy.posterior_y * back, sign * anatomy.condyle_spread_mm])
        rows.append(ellipsoid_row(pose, centre, np.array(half_axes) - cortex_mm))
    return rows
