"""The nail's pose at zero tilt from the places of its holes in the image: a start for the fit, not a measurement."""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform


def hole_midpoints_mm(nail: NailPart) -> NDArray[np.float64]:
    """Middle of each hole inside the metal, shape (N, 3), in the nail's frame."""
    return np.array([np.mean(hole_surface_points(nail, hole), axis=0) for hole in nail.holes])


def mean_hole_direction(nail: NailPart) -> NDArray[np.float64]:
    """Mean direction of the holes' axes in the nail's frame, unit, shape (3,)."""
    return unit(np.sum([hole.axis.direction for hole in nail.holes], axis=0))


def camera_from_nail_facing(
    nail: NailPart,
    hole_rays_camera: NDArray[np.float64],
    hole_axis_camera: NDArray[np.float64],
    distal_camera: NDArray[np.float64],
    depth_from_width_mm: float,
) -> Transform[Camera, Nail]:
    """Pose with the holes' mean axis along a given direction that puts every hole on its ray.

    With the axis given, a rotation about it, a shift across it and a depth remain: they follow from a linear fit of the
    holes' places to the rays (in complex numbers: rotation and scale are one factor).

    Parameters
    ----------
    hole_rays_camera
        Unit direction of the ray through each opening's centre, in the order of the nail's holes, shape (N, 3).
    hole_axis_camera
        Direction that the holes' mean axis is to have, unit, shape (3,).
    distal_camera
        Rough direction of the nail's +x, shape (3,). Used alone when there is only one hole.
    depth_from_width_mm
        Depth to use when there is only one hole.

    Returns
    -------
    Transform
        `camera_from_nail`. Several holes give the depth; a tilt of 10 degrees about the band's normal makes it 1.5 %
        too large.
    """
    view = _frame_about(hole_axis_camera, distal_camera)
    flat = _frame_about(mean_hole_direction(nail), np.array([1.0, 0.0, 0.0]))
    holes = hole_midpoints_mm(nail) @ flat.T
    rays = hole_rays_camera @ view.T
    # A point at (x, y, z + depth) appears at (x, y) / (depth + z); z varies by millimetres against 700 mm of depth.
    seen = (rays[:, 0] + 1j * rays[:, 1]) / rays[:, 2]
    known = holes[:, 0] + 1j * holes[:, 1]
    if len(known) == 1:
        factor, shift = 1.0 / depth_from_width_mm + 0j, seen[0] - known[0] / depth_from_width_mm
    else:
        design = np.stack([known, np.ones_like(known)], axis=-1)
        (factor, shift), *_ = np.linalg.lstsq(design, seen, rcond=None)
    depth_mm = 1.0 / abs(factor)
    spin = factor * depth_mm
    turn = np.array([[spin.real, -spin.imag, 0.0], [spin.imag, spin.real, 0.0], [0.0, 0.0, 1.0]])
    rotation = view.T @ turn @ flat
    origin = view.T @ np.array([shift.real * depth_mm, shift.imag * depth_mm, depth_mm - float(holes[:, 2].mean())])
    return Transform.from_rotation_translation(rotation, origin)


def _frame_about(z_axis: NDArray[np.float64], near_x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation, shape (3, 3), whose rows are a right-handed frame with the given z, and x near the given direction."""
    z = unit(z_axis)
    x = unit(near_x - z * (near_x @ z))
    return np.stack([x, np.cross(z, x), z])
