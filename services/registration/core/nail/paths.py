"""Lengths of rays in metal and plastic: closed forms for cylinders, balls and boxes.

Rays are given by their direction in the camera frame with z = 1, so that `s` along a ray is the depth in mm; lengths
are therefore multiplied by the direction's norm.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.pixel_rays import PixelRays
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


class Balls(NamedTuple):
    """Balls in the camera's frame.

    Attributes
    ----------
    centre_mm, radius_mm
        Shapes (B, 3) and (B,).
    spread
        By how much the places in a pixel are spread for each of them (`penumbra.py`), shape (B,).
    """

    centre_mm: NDArray[np.float64]
    radius_mm: NDArray[np.float64]
    spread: NDArray[np.float64]


@compiled
def add_ball_paths(rays: PixelRays, places_px: NDArray[np.float64], balls: Balls, out_mm: NDArray[np.float64]) -> None:
    """Add the lengths in balls of the rays at places, shape (K, 2), in each of S pixels to `out_mm`, shape (S, K)."""
    if rays.slopes.shape[0] == 0:
        return
    slopes = rays.slopes
    low_x, high_x = slopes[:, 0].min(), slopes[:, 0].max()
    low_y, high_y = slopes[:, 1].min(), slopes[:, 1].max()
    pixel = max(np.abs(rays.right).max(), np.abs(rays.down).max())
    for ball in range(balls.radius_mm.shape[0]):
        x, y, z = balls.centre_mm[ball, 0], balls.centre_mm[ball, 1], balls.centre_mm[ball, 2]
        spread = balls.spread[ball]
        reach = 1.05 * balls.radius_mm[ball] / z + spread * pixel
        if x / z + reach < low_x or x / z - reach > high_x or y / z + reach < low_y or y / z - reach > high_y:
            continue
        for n in range(slopes.shape[0]):
            if abs(slopes[n, 0] - x / z) > reach or abs(slopes[n, 1] - y / z) > reach:
                continue
            right, down = rays.right[n], rays.down[n]
            for k in range(places_px.shape[0]):
                column, row = spread * places_px[k, 0], spread * places_px[k, 1]
                cx = slopes[n, 0] + column * right[0] + row * down[0]
                cy = slopes[n, 1] + column * right[1] + row * down[1]
                out_mm[n, k] += _path_in_ball(cx, cy, x, y, z, balls.radius_mm[ball])


@compiled
def _path_in_ball(cx: float, cy: float, x: float, y: float, z: float, radius_mm: float) -> float:
    """Length of the ray in direction (cx, cy, 1) in a ball at (x, y, z)."""
    along = (cx * x + cy * y + z) / (cx * cx + cy * cy + 1.0)
    ex, ey, ez = cx * along - x, cy * along - y, along - z
    inside = radius_mm * radius_mm - (ex * ex + ey * ey + ez * ez)
    return float(2.0 * np.sqrt(max(inside, 0.0)))


class Blocks(NamedTuple):
    """Boxes with bores, in their own frame.

    Attributes
    ----------
    rotation, translation_mm
        `camera_from_` that frame, shapes (3, 3) and (3,).
    boxes_mm
        Centre and size, shape (B, 6).
    bores
        Point, unit direction and radius, shape (H, 7).
    """

    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    boxes_mm: NDArray[np.float64]
    bores: NDArray[np.float64]


@compiled
def _path_in(blocks: Blocks, origin: NDArray[np.float64], cx: float, cy: float) -> float:
    """Length of the ray in direction (cx, cy, 1) from the focal spot, which is at `origin` in the blocks' frame."""
    turn, boxes, bores, total = blocks.rotation, blocks.boxes_mm, blocks.bores, 0.0
    dx = turn[0, 0] * cx + turn[1, 0] * cy + turn[2, 0]
    dy = turn[0, 1] * cx + turn[1, 1] * cy + turn[2, 1]
    dz = turn[0, 2] * cx + turn[1, 2] * cy + turn[2, 2]
    for box in range(boxes.shape[0]):
        near, far = _between(boxes[box, 0] - origin[0], 0.5 * boxes[box, 3], dx, -_EVERYWHERE, _EVERYWHERE)
        near, far = _between(boxes[box, 1] - origin[1], 0.5 * boxes[box, 4], dy, near, far)
        near, far = _between(boxes[box, 2] - origin[2], 0.5 * boxes[box, 5], dz, near, far)
        if far <= near:
            continue
        total += far - near
        for h in range(bores.shape[0]):
            ox, oy, oz = origin[0] - bores[h, 0], origin[1] - bores[h, 1], origin[2] - bores[h, 2]
            a, b = cylinder_interval(ox, oy, oz, dx, dy, dz, bores[h, 3], bores[h, 4], bores[h, 5], bores[h, 6])
            if b > a:
                total -= max(0.0, min(b, far) - max(a, near))
    return float(max(total, 0.0) * np.sqrt(cx * cx + cy * cy + 1.0))


@compiled
def _between(middle: float, half: float, slope: float, near: float, far: float) -> tuple[float, float]:
    """Part of a ray, from `near` to `far`, that lies between two faces of a box."""
    inverse = 1.0 / slope
    first, last = (middle - half) * inverse, (middle + half) * inverse
    return max(near, min(first, last)), min(far, max(first, last))


@compiled
def _mean_paths(rays: PixelRays, places_px: NDArray[np.float64], blocks: Blocks, out_mm: NDArray[np.float64]) -> None:
    origin = -(blocks.rotation.T @ blocks.translation_mm)
    for n in range(rays.slopes.shape[0]):
        total, right, down = 0.0, rays.right[n], rays.down[n]
        for k in range(places_px.shape[0]):
            x, y = places_px[k, 0], places_px[k, 1]
            cx = rays.slopes[n, 0] + x * right[0] + y * down[0]
            cy = rays.slopes[n, 1] + x * right[1] + y * down[1]
            total += _path_in(blocks, origin, cx, cy)
        out_mm[n] = total / places_px.shape[0]


def guide_body_path(
    rays: PixelRays, places_px: NDArray[np.float64], camera_from_guide: Transform[Camera, Guide], guide: GuidePart
) -> NDArray[np.float64]:
    """Length in the guide's Delrin, bores left out, mean over places, shape (K, 2), within each pixel; (S,), in mm."""
    out = np.zeros(len(rays.slopes))
    if not guide.body:
        return out
    boxes = np.array([(*box.centre_mm, *box.size_mm) for box in guide.body])
    bores = [(*hole.axis.point_mm, *hole.axis.direction, 0.5 * hole.diameter_mm) for hole in guide.holes]
    placed = camera_from_guide.rotation, camera_from_guide.translation_mm
    _mean_paths(rays, places_px, Blocks(*placed, boxes, np.array(bores).reshape(-1, 7)), out)
    return out


def nail_rays(
    directions: NDArray[np.float64], camera_from_nail: Transform[Camera, Nail]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rays, shape (N, 2), in the nail's frame: the focal spot, shape (3,), and directions, shape (N, 3)."""
    in_camera = np.column_stack([directions, np.ones(len(directions))])
    inverse = camera_from_nail.inverse()
    return inverse.translation_mm, inverse.directions(in_camera)
