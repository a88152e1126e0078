"""Known things in front of or behind the nail: guide (balls, body), the ring's balls, K-wires, and their penumbra."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.rays import (
    EVERYWHERE,
    FIRST_SAMPLES,
    SAMPLES_PX,
    PixelRays,
    cylinder_interval,
    sample_directions,
)
from services.registration.core.tuning import BEAM, FIT_REGION
from shared.compiled import compiled, compiled_inline
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import read_only
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True)
class Penumbra:
    """Softness of edges by the focal spot, compared with the nail's own.

    A focal spot blurs edges the more, the nearer to it they are. Its effect on the nail's edges is in the fitted blur,
    which acts on the whole image; the guide's edges are softer, those of the ring's balls sharper. Balls have the
    steepest edges in the image: with the nail's blur on them, attenuation and curve become a compromise, and holes are
    estimated too wide and the nail too tilted.
    """

    # Depths from the focal spot: of the ring's near plate, which stands for the detector some 2 % behind it, and of the
    # nail
    plate_mm: float
    nail_mm: float
    spot_px: float  # edge of the focal spot in pixels at the plate

    @staticmethod
    def beside(calibration: CArmCalibration, nail_mm: float, side_px: float) -> "Penumbra":
        """That of a C-arm, in pixels which have a side of so many image pixels, beside a nail of known depth."""
        plate_mm = float(calibration.camera_from_ring.translation_mm[2])
        px_per_mm = calibration.camera.focal_length_px / plate_mm / side_px
        spot_mm = BEAM.focal_spot_mm if calibration.focal_spot_mm is None else calibration.focal_spot_mm
        return Penumbra(plate_mm, nail_mm, spot_mm * px_per_mm)

    def width_px(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Width of an edge's penumbra by its depth, nothing behind the plate; shape of the depths."""
        return np.asarray(self.spot_px * np.maximum(self.plate_mm / depth_mm - 1.0, 0.0))

    def spread(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much to spread the places in a pixel at which something is looked at; shape of the depths.

        The mean over these places blurs edges as a square of the pixel's size does. Spread out they add the variance
        that an edge's penumbra has more than the nail's, drawn together they take away what it has less, as far as a
        pixel has that much: the ring's balls become sharp enough on pixels of 0.17 mm and more.
        """
        more = self.width_px(depth_mm) ** 2 - self.width_px(np.array(self.nail_mm)) ** 2
        return np.asarray(np.sqrt(np.maximum(1.0 + more, BEAM.least_spread**2)))


class Balls(NamedTuple):
    """Balls in the camera's frame."""

    centre_mm: NDArray[np.float64]  # shape (B, 3)
    radius_mm: NDArray[np.float64]  # shape (B,)
    # By how much the places in a pixel are spread for each of them (`Penumbra`), shape (B,)
    spread: NDArray[np.float64]


# Slopes of the rays through a ball, over its radius over its depth: 1.03 at a slope of 0.25, beyond any image's edge.
_OBLIQUE = 1.05


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
        reach = _OBLIQUE * balls.radius_mm[ball] / z + spread * pixel
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


@compiled_inline
def _path_in_ball(cx: float, cy: float, x: float, y: float, z: float, radius_mm: float) -> float:
    """Length of the ray in direction (cx, cy, 1) in a ball at (x, y, z)."""
    along = (cx * x + cy * y + z) / (cx * cx + cy * cy + 1.0)
    ex, ey, ez = cx * along - x, cy * along - y, along - z
    inside = radius_mm * radius_mm - (ex * ex + ey * ey + ez * ez)
    return float(2.0 * np.sqrt(max(inside, 0.0)))


class DrilledBoxes(NamedTuple):
    """Boxes with bores, in their own frame."""

    # `camera_from_` that frame, shapes (3, 3) and (3,)
    rotation: NDArray[np.float64]
    translation_mm: NDArray[np.float64]
    boxes_mm: NDArray[np.float64]  # centre and size, shape (B, 6)
    bores: NDArray[np.float64]  # point, unit direction and radius, shape (H, 7)


@compiled_inline
def _path_in(blocks: DrilledBoxes, origin: NDArray[np.float64], cx: float, cy: float) -> float:
    """Length of the ray in direction (cx, cy, 1) from the focal spot, which is at `origin` in the blocks' frame."""
    turn, boxes, bores, total = blocks.rotation, blocks.boxes_mm, blocks.bores, 0.0
    dx = turn[0, 0] * cx + turn[1, 0] * cy + turn[2, 0]
    dy = turn[0, 1] * cx + turn[1, 1] * cy + turn[2, 1]
    dz = turn[0, 2] * cx + turn[1, 2] * cy + turn[2, 2]
    for box in range(boxes.shape[0]):
        near, far = _between(boxes[box, 0] - origin[0], 0.5 * boxes[box, 3], dx, -EVERYWHERE, EVERYWHERE)
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


@compiled_inline
def _between(middle: float, half: float, slope: float, near: float, far: float) -> tuple[float, float]:
    """Part of a ray, from `near` to `far`, that lies between two faces of a box."""
    inverse = 1.0 / slope
    first, last = (middle - half) * inverse, (middle + half) * inverse
    return max(near, min(first, last)), min(far, max(first, last))


@compiled
def _mean_paths(
    rays: PixelRays, places_px: NDArray[np.float64], blocks: DrilledBoxes, out_mm: NDArray[np.float64]
) -> None:
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
    boxes = np.array([(*box.centre_mm, *box.size_mm) for box in guide.body])
    bores = [(*hole.axis.point_mm, *hole.axis.direction, 0.5 * hole.diameter_mm) for hole in guide.holes]
    placed = camera_from_guide.rotation, camera_from_guide.translation_mm
    _mean_paths(rays, places_px, DrilledBoxes(*placed, boxes, np.array(bores).reshape(-1, 7)), out)
    return out


@dataclass(frozen=True, slots=True, eq=False)
class SteelRod:
    """A straight round rod."""

    # Its ends on the axis, in the camera's frame, shape (3,)
    start_camera_mm: NDArray[np.float64]
    end_camera_mm: NDArray[np.float64]
    diameter_mm: float

    def __post_init__(self) -> None:
        for name in ("start_camera_mm", "end_camera_mm"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def discs_px(self, calibration: CArmCalibration, wider_mm: float) -> NDArray[np.float64]:
        """The rod as discs along its image: centre x, y and radius in measured pixels, shape (K, 3)."""
        way = np.linspace(0.0, 1.0, FIT_REGION.wire_discs)[:, None]
        centres_mm = (1.0 - way) * self.start_camera_mm + way * self.end_camera_mm
        radius_mm = 0.5 * self.diameter_mm + wider_mm
        radius_px = radius_mm * calibration.camera.focal_length_px / centres_mm[:, 2]
        return np.column_stack([calibration.image_from_camera(centres_mm), radius_px])


def add_rod_path(directions: NDArray[np.float64], rod: SteelRod, out_mm: NDArray[np.float64]) -> None:
    """Add the length of each ray, directions of shape (N, 2) at z = 1, in a rod to `out_mm`, shape (N,)."""
    along = rod.end_camera_mm - rod.start_camera_mm
    length_mm = float(np.linalg.norm(along))
    _add_rod_path(
        directions, np.array(rod.start_camera_mm), along / length_mm, length_mm, 0.5 * rod.diameter_mm, out_mm
    )


@compiled
def _add_rod_path(
    directions: NDArray[np.float64],
    start: NDArray[np.float64],
    along: NDArray[np.float64],
    length_mm: float,
    radius_mm: float,
    out_mm: NDArray[np.float64],
) -> None:
    for n in range(directions.shape[0]):
        cx, cy = directions[n, 0], directions[n, 1]
        near, far = cylinder_interval(
            -start[0], -start[1], -start[2], cx, cy, 1.0, along[0], along[1], along[2], radius_mm
        )
        if far <= near:
            continue
        # places along the rod: linear in the depth s, and only those between its two flat ends count
        slope = cx * along[0] + cy * along[1] + along[2]
        offset = -(start[0] * along[0] + start[1] * along[1] + start[2] * along[2])
        if abs(slope) > 0.0:
            first, second = -offset / slope, (length_mm - offset) / slope
            near, far = max(near, min(first, second)), min(far, max(first, second))
        elif offset < 0.0 or offset > length_mm:
            continue
        if far > near:
            out_mm[n] += (far - near) * np.sqrt(cx * cx + cy * cy + 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedGuide:
    """A guide and where it is."""

    part: GuidePart
    camera_from_guide: Transform[Camera, Guide]


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """What shares the image with the nail. `None`: not there, or not known."""

    # Have a known shape and place, and are modelled
    guide: PlacedGuide | None
    ring: RingPart | None
    # Pixels where something of unknown shape covers the nail, shape (rows, columns): they are left out
    hidden: NDArray[np.bool_] | None = None
    rods: tuple[SteelRod, ...] = ()  # K-wires of known place, modelled too


def steel_path_mm(
    rays: PixelRays, occluders: Occluders, calibration: CArmCalibration, penumbra: Penumbra
) -> NDArray[np.float64]:
    """Length in steel (balls of guide and ring, wires) at the `SAMPLES_PX` in each of S pixels; (S, samples), in mm."""
    out = np.zeros((len(rays.slopes), len(SAMPLES_PX)))
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        balls = Balls(np.ascontiguousarray(centres_mm), 0.5 * diameters_mm, penumbra.spread(centres_mm[:, 2]))
        add_ball_paths(rays, SAMPLES_PX, balls, out)
    # wires pass through the nail: its penumbra is theirs
    for rod in occluders.rods:
        add_rod_path(sample_directions(rays, SAMPLES_PX), rod, out.reshape(-1))
    return out


def ball_discs_px(occluders: Occluders, calibration: CArmCalibration) -> NDArray[np.float64]:
    """Where balls of guide and ring are in the image: centre x, y and radius in measured pixels, shape (B, 3)."""
    discs = [np.zeros((0, 3))]
    for centres_mm, diameters_mm in _balls_camera(occluders, calibration):
        radius_px = 0.5 * diameters_mm * calibration.camera.focal_length_px / centres_mm[:, 2]
        discs.append(np.column_stack([calibration.image_from_camera(centres_mm), radius_px]))
    return np.concatenate(discs)


def guide_body_path_mm(rays: PixelRays, occluders: Occluders, penumbra: Penumbra) -> NDArray[np.float64]:
    """Mean length in the guide's body over a few places in each of S pixels, shape (S,), in mm."""
    guide = occluders.guide
    if guide is None or not guide.part.body:
        return np.zeros(len(rays.slopes))
    middle_mm = np.mean([box.centre_mm for box in guide.part.body], axis=0)
    spread = penumbra.spread((guide.camera_from_guide @ middle_mm)[2])
    return guide_body_path(rays, spread * SAMPLES_PX[:FIRST_SAMPLES], guide.camera_from_guide, guide.part)


def _balls_camera(
    occluders: Occluders, calibration: CArmCalibration
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    groups = []
    if occluders.guide is not None:
        balls = occluders.guide.part.balls
        groups.append((occluders.guide.camera_from_guide.points(balls.position_mm), balls.diameter_mm))
    if occluders.ring is not None:
        balls = occluders.ring.balls
        groups.append((calibration.camera_from_ring.points(balls.position_mm), balls.diameter_mm))
    return groups
