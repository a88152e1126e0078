"""Lengths of rays in metal and plastic: closed forms for cylinders, balls and boxes.

Rays are given by their direction in the camera frame with z = 1, so that `s` along a ray is the depth in mm; lengths
are therefore multiplied by the direction's norm. All loops run over sub-pixel samples, flattened.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform

PARALLEL = 1e-14
_EVERYWHERE = 1e9


@compiled
def cylinder_interval(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, wx: float, wy: float, wz: float, radius: float
) -> tuple[float, float]:
    """Where the ray o + s d is inside an endless cylinder through the origin along w (unit); empty as (1, 0)."""
    along_d = dx * wx + dy * wy + dz * wz
    along_o = ox * wx + oy * wy + oz * wz
    px, py, pz = dx - along_d * wx, dy - along_d * wy, dz - along_d * wz
    qx, qy, qz = ox - along_o * wx, oy - along_o * wy, oz - along_o * wz
    a = px * px + py * py + pz * pz
    c = qx * qx + qy * qy + qz * qz - radius * radius
    if a < PARALLEL:
        return (-_EVERYWHERE, _EVERYWHERE) if c < 0.0 else (1.0, 0.0)
    b = px * qx + py * qy + pz * qz
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        return (1.0, 0.0)
    root = np.sqrt(discriminant)
    return ((-b - root) / a, (-b + root) / a)


@compiled
def add_ball_paths(
    directions: NDArray[np.float64],
    centres_camera_mm: NDArray[np.float64],
    radii_mm: NDArray[np.float64],
    out_mm: NDArray[np.float64],
) -> None:
    """Add the length of each ray, shape (N, 2), in balls at camera positions, shape (B, 3), to `out_mm`, shape (N,)."""
    if directions.shape[0] == 0:
        return
    low_x, high_x = directions[:, 0].min(), directions[:, 0].max()
    low_y, high_y = directions[:, 1].min(), directions[:, 1].max()
    for ball in range(centres_camera_mm.shape[0]):
        x, y, z = centres_camera_mm[ball, 0], centres_camera_mm[ball, 1], centres_camera_mm[ball, 2]
        reach = 1.05 * radii_mm[ball] / z
        if x / z + reach < low_x or x / z - reach > high_x or y / z + reach < low_y or y / z - reach > high_y:
            continue
        for n in range(directions.shape[0]):
            cx, cy = directions[n, 0], directions[n, 1]
            if abs(cx - x / z) > reach or abs(cy - y / z) > reach:
                continue
            norm2 = cx * cx + cy * cy + 1.0
            along = (cx * x + cy * y + z) / norm2
            ex, ey, ez = cx * along - x, cy * along - y, along - z
            inside = radii_mm[ball] ** 2 - (ex * ex + ey * ey + ez * ez)
            if inside > 0.0:
                out_mm[n] += 2.0 * np.sqrt(inside)


@compiled
def _block_paths(
    directions: NDArray[np.float64],
    rotation: NDArray[np.float64],
    translation_mm: NDArray[np.float64],
    boxes_mm: NDArray[np.float64],
    bore_points_mm: NDArray[np.float64],
    bore_directions: NDArray[np.float64],
    bore_radii_mm: NDArray[np.float64],
    out_mm: NDArray[np.float64],
) -> None:
    origin = -(rotation.T @ translation_mm)
    d = np.empty(3)
    for n in range(directions.shape[0]):
        cx, cy = directions[n, 0], directions[n, 1]
        for k in range(3):
            d[k] = rotation[0, k] * cx + rotation[1, k] * cy + rotation[2, k]
        total = 0.0
        for box in range(boxes_mm.shape[0]):
            near, far = -_EVERYWHERE, _EVERYWHERE
            for k in range(3):
                low = (boxes_mm[box, k] - 0.5 * boxes_mm[box, 3 + k] - origin[k]) / d[k]
                high = (boxes_mm[box, k] + 0.5 * boxes_mm[box, 3 + k] - origin[k]) / d[k]
                near, far = max(near, min(low, high)), min(far, max(low, high))
            if far <= near:
                continue
            total += far - near
            for h in range(bore_points_mm.shape[0]):
                a, b = cylinder_interval(
                    origin[0] - bore_points_mm[h, 0],
                    origin[1] - bore_points_mm[h, 1],
                    origin[2] - bore_points_mm[h, 2],
                    d[0],
                    d[1],
                    d[2],
                    bore_directions[h, 0],
                    bore_directions[h, 1],
                    bore_directions[h, 2],
                    bore_radii_mm[h],
                )
                if b > a:
                    total -= max(0.0, min(b, far) - max(a, near))
        out_mm[n] = max(total, 0.0) * np.sqrt(cx * cx + cy * cy + 1.0)


def guide_body_path(
    directions: NDArray[np.float64], camera_from_guide: Transform[Camera, Guide], guide: GuidePart
) -> NDArray[np.float64]:
    """Length of each ray, shape (N, 2), in the guide's Delrin, bores left out; shape (N,), in mm."""
    out = np.zeros(directions.shape[0])
    if not guide.body:
        return out
    boxes = np.array([(*box.centre_mm, *box.size_mm) for box in guide.body])
    _block_paths(
        directions,
        camera_from_guide.rotation,
        camera_from_guide.translation_mm,
        boxes,
        np.array([hole.axis.point_mm for hole in guide.holes]).reshape(-1, 3),
        np.array([hole.axis.direction for hole in guide.holes]).reshape(-1, 3),
        np.array([0.5 * hole.diameter_mm for hole in guide.holes]),
        out,
    )
    return out


def nail_rays(
    directions: NDArray[np.float64], camera_from_nail: Transform[Camera, Nail]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rays, shape (N, 2), in the nail's frame: the focal spot, shape (3,), and directions, shape (N, 3)."""
    in_camera = np.column_stack([directions, np.ones(len(directions))])
    inverse = camera_from_nail.inverse()
    return inverse.translation_mm, inverse.directions(in_camera)
