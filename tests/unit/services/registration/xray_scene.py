"""Small X-ray scenes for the tests: blurred cylinders and balls on texture, with their own arithmetic.

Deliberately apart from the product's image model: path lengths come from slabs of sampled depth, not from closed forms.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from services.registration.core.c_arm_advice import CArmTurn
from shared.geometry.calibration import BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole, Material, NailPart, hole_surface_points
from shared.geometry.transform import Transform
from tests.kept import kept

FOCAL_PX = 4200.0
RING_DEPTH_MM = 950.0
METAL_PER_MM: dict[Material, float] = {"steel": 0.9, "Ti6Al4V": 0.3}
# Shares of a beam's energies, and their attenuations by metal over the mean.
ONE_ENERGY = np.array([[1.0], [1.0]])
AS_OF_A_TUBE = np.array([[0.3, 0.4, 0.3], [0.55, 0.9, 1.58]])
_DEPTH_STEP_MM = 0.25
_X = np.array([1.0, 0.0, 0.0])
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Rod:
    """A round rod (a wire, a screw) between two points in the camera's frame; steel unless told otherwise."""

    start_mm: NDArray[np.float64]
    end_mm: NDArray[np.float64]
    diameter_mm: float
    per_mm: float = METAL_PER_MM["steel"]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is in front of the detector, in the camera's frame; `balls` are centres with a diameter, shape (B, 4).

    `beam`, shape (2, E), has the energies: their shares, and their attenuations by metal over the mean.
    """

    size_px: int
    nail: NailPart | None = None
    camera_from_nail: Transform[Camera, Nail] | None = None
    rods: tuple[Rod, ...] = ()
    balls: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    noise: float = 0.01
    texture: float = 0.05
    beam: NDArray[np.float64] = field(default_factory=ONE_ENERGY.copy)
    hole_content_per_mm: float = 0.0  # attenuation in the nail's holes over that beside the nail
    content_rise: tuple[float, float] = (0.0, 0.0)  # its increase from their middles to the wall, along and across
    channel_share: float = 0.0  # width of a channel along the beam through that, over the holes'


def calibration(size_px: int, distortion: DisplacementField | None = None) -> CArmCalibration:
    """A C-arm whose focal spot looks at the image's middle."""
    middle = 0.5 * (size_px - 1)
    K = np.array([[FOCAL_PX, 0.0, middle], [0.0, FOCAL_PX, middle], [0.0, 0.0, 1.0]])
    none = np.zeros(0)
    return CArmCalibration(
        size_px,
        size_px,
        False,
        PinholeCamera(K),
        Transform.from_rotation_translation(np.eye(3), np.array([0.0, 0.0, RING_DEPTH_MM])),
        DisplacementField.zero(size_px, size_px) if distortion is None else distortion,
        np.eye(3),
        BallCandidates(np.zeros((0, 2)), none, none, none, np.zeros(0, np.int64)),
        120,
        0.05,
        0.05,
        50.0,
        None,
    )


def pincushion(size_px: int, edge_fraction: float) -> DisplacementField:
    """Distortion that moves the image's edge by a fraction of its distance from the middle."""
    nodes = np.linspace(-40.0, size_px + 40.0, 12)
    x, y = np.meshgrid(nodes, nodes)
    middle = 0.5 * (size_px - 1)
    offset = np.stack([x - middle, y - middle], axis=-1)
    square = (offset**2).sum(axis=-1, keepdims=True) / middle**2
    return DisplacementField(
        np.full(2, nodes[0]), float(nodes[1] - nodes[0]), -edge_fraction * offset * square, np.zeros((12, 12))
    )


def nail_part(
    hole_x_mm: tuple[float, ...] = (15.0, -15.0),
    material: Material = "steel",
    diameter_mm: float = 12.0,
    hole_diameter_mm: float = 6.0,
    tip_x_mm: float = 38.0,
) -> NailPart:
    """A nail with parallel holes; the first two are called as in the catalogue."""
    names = ["distal", "proximal", "third", "fourth"]
    holes = tuple(
        Hole(name, Line(np.array([x, 0.0, 0.0]), _Z), hole_diameter_mm)
        for name, x in zip(names, hole_x_mm, strict=False)
    )
    return NailPart(material, diameter_mm, 4.5 if material == "Ti6Al4V" else 0.0, tip_x_mm, holes, "0" * 64)


def guide_part() -> GuidePart:
    """A guide with two holes 30 mm apart in a block 25 mm thick; few balls, far from the holes."""
    balls = np.array([[x, y, z] for x in (-25.0, 25.0) for y in (-18.0, 18.0) for z in (-10.0, 10.0)])
    pattern = BallPattern(tuple(f"G{k}" for k in range(len(balls))), balls, np.full(len(balls), 2.0))
    holes = tuple(
        Hole(name, Line(np.array([x, 0.0, 0.0]), _Z), 5.0) for name, x in (("distal", 15.0), ("proximal", -15.0))
    )
    return GuidePart(pattern, holes, (Box((0.0, 0.0, 0.0), (55.0, 40.0, 25.0)),), "0" * 64)


def posed_nail(
    spin_deg: float,
    tilt_xy_deg: tuple[float, float] = (0.0, 0.0),
    at_mm: tuple[float, float, float] = (0.0, 0.0, 740.0),
) -> Transform[Camera, Nail]:
    """A nail whose x axis is turned in the image by `spin_deg`, then tilted about the camera's x and y axes."""
    spin = Rotation.from_euler("z", spin_deg, degrees=True)
    tilt = Rotation.from_euler("xy", tilt_xy_deg, degrees=True)
    return Transform.from_rotation_translation((tilt * spin).as_matrix(), np.array(at_mm))


def posed_guide(spin_deg: float, at_mm: tuple[float, float, float]) -> Transform[Camera, Guide]:
    """A guide that faces the beam."""
    return Transform.from_rotation_translation(
        Rotation.from_euler("z", spin_deg, degrees=True).as_matrix(), np.array(at_mm)
    )


@kept
def render(scene: Scene, view: CArmCalibration, seed: int) -> NDArray[np.float32]:
    """Grey values 0..1: attenuation, texture, blur of 1.2 px, correlated noise, and a display curve."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : scene.size_px, 0 : scene.size_px].astype(np.float64)
    rays = view.rays_camera(np.stack([x, y], axis=-1))
    rays = rays / rays[..., 2:]
    thickness = gaussian_filter(rng.standard_normal(x.shape), 9.0) * 9.0 * 3.5 * scene.texture
    tissue, metal = 0.5 + thickness + 0.15 * x / scene.size_px, np.zeros_like(x)
    if scene.nail is not None and scene.camera_from_nail is not None:
        path_mm = _nail_path_mm(rays, scene.nail, scene.camera_from_nail)
        metal = metal + METAL_PER_MM[scene.nail.material] * path_mm
        if scene.hole_content_per_mm != 0.0 or any(scene.content_rise):
            solid_mm = _nail_path_mm(rays, replace(scene.nail, holes=()), scene.camera_from_nail)
            place = _rise(rays, scene.nail, scene.camera_from_nail)
            content = scene.hole_content_per_mm + place @ scene.content_rise
            filled = np.linalg.norm(place, axis=-1) >= scene.channel_share
            tissue = tissue + filled * content * (solid_mm - path_mm)
    for rod in scene.rods:
        metal = metal + rod.per_mm * _rod_path_mm(rays, rod)
    metal = metal + METAL_PER_MM["steel"] * _ball_paths_mm(rays, scene.balls)
    shares, over_mean = scene.beam
    passed = np.exp(-metal[..., None] * over_mean) @ shares
    light = gaussian_filter(np.exp(-tissue) * passed, 1.2)
    light = light + gaussian_filter(rng.standard_normal(x.shape), 0.8) * 2.8 * scene.noise * np.sqrt(light)
    return np.asarray((np.clip(light + 0.08, 0.0, None) ** 0.7), dtype=np.float32)


def _nail_path_mm(
    rays: NDArray[np.float64], nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Length in metal by sampling depth: inside the cylinder, before the rounded tip, outside the holes."""
    axis = camera_from_nail.rotation[:, 0]
    near = _distance_of_lines_mm(rays, camera_from_nail.translation_mm, axis) < nail.radius_mm + 3.0 * nail.is_bent
    middle_mm, reach_mm = float(camera_from_nail.translation_mm[2]), 1.6 * nail.diameter_mm
    # coordinates are rows, which numpy reads several times faster than columns
    along_rays = camera_from_nail.rotation.T @ rays[near].T
    spot_nail_mm = camera_from_nail.inverse().translation_mm[:, None]
    length = np.zeros(along_rays.shape[1])
    for depth_mm in np.arange(middle_mm - reach_mm, middle_mm + reach_mm, _DEPTH_STEP_MM):
        length += _in_metal(_straightened_mm(along_rays * depth_mm + spot_nail_mm, nail), nail)
    total = np.zeros(rays.shape[:2])
    total[near] = length * _DEPTH_STEP_MM
    return total


def _rise(rays: NDArray[np.float64], nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """Where rays pass the plane halfway through the nail, from the nearest hole's axis in radii, shape (..., 2)."""
    nail_from_camera = camera_from_nail.inverse()
    along_rays = rays @ nail_from_camera.rotation.T
    spot_mm = nail_from_camera.translation_mm
    places_mm = (spot_mm - along_rays * (spot_mm[2] / along_rays[..., 2:]))[..., :2]
    of_holes = [(places_mm - hole.axis.point_mm[:2]) / (0.5 * hole.diameter_mm) for hole in nail.holes]
    nearest = np.argmin([np.linalg.norm(places, axis=-1) for places in of_holes], axis=0)
    return np.asarray(np.choose(nearest[..., None], of_holes))


def _in_metal(points_mm: NDArray[np.float64], nail: NailPart) -> NDArray[np.bool_]:
    """Whether points, shape (3, N), are in a straight nail's metal, shape (N,)."""
    x, y, z = points_mm
    across2 = y * y + z * z
    beyond = np.maximum(x - (nail.tip_x_mm - nail.radius_mm), 0.0)
    metal = across2 + beyond * beyond <= nail.radius_mm**2
    metal &= across2 >= (0.5 * nail.cannulation_diameter_mm) ** 2
    for hole in nail.all_holes:
        for shift_mm in np.linspace(-hole.half_slot_mm, hole.half_slot_mm, 9 if hole.half_slot_mm > 0.0 else 1):
            axis = Line(hole.axis.point_mm + shift_mm * hole.along_nail(), hole.axis.direction)
            metal &= _away2_mm2(points_mm, axis) > (0.5 * hole.diameter_mm) ** 2
    return np.asarray(metal)


def _away2_mm2(points_mm: NDArray[np.float64], axis: Line) -> NDArray[np.float64]:
    """Square of the distance of points, shape (3, N), from a line, shape (N,)."""
    x, y, z = points_mm - axis.point_mm[:, None]
    a, b, c = axis.direction
    along = a * x + b * y + c * z
    return np.asarray(x * x + y * y + z * z - along * along)


def _straightened_mm(points_mm: NDArray[np.float64], nail: NailPart) -> NDArray[np.float64]:
    """Points of a bent nail where they are in the straight one: arcs about one centre become lines, shape (3, N)."""
    if not nail.is_bent:
        return points_mm
    y, z = nail.curvature_per_m
    size = np.hypot(y, z)
    inwards, radius_mm = np.array([0.0, y, z]) / size, 1000.0 / size
    below = inwards @ points_mm
    along = radius_mm * np.arctan2(points_mm[0], radius_mm - below)
    aside = radius_mm - np.hypot(points_mm[0], radius_mm - below)
    beside = points_mm - inwards[:, None] * below
    return np.asarray(beside * [[0.0], [1.0], [1.0]] + _X[:, None] * along + inwards[:, None] * aside)


def _distance_of_lines_mm(
    rays: NDArray[np.float64], point_mm: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of each ray from a line, shape (rows, columns), in mm."""
    normal = np.cross(rays, direction)
    return np.asarray(np.abs(normal @ point_mm) / np.linalg.norm(normal, axis=-1))


def _rod_path_mm(rays: NDArray[np.float64], rod: Rod) -> NDArray[np.float64]:
    low, high = sorted((float(rod.start_mm[2]), float(rod.end_mm[2])))
    length = float(np.linalg.norm(rod.end_mm - rod.start_mm))
    axis = Line(rod.start_mm, (rod.end_mm - rod.start_mm) / length)
    near = _distance_of_lines_mm(rays, rod.start_mm, axis.direction) < 0.5 * rod.diameter_mm
    seen = np.ascontiguousarray(rays[near].T)
    along_rays, before_start = axis.direction @ seen, axis.direction @ rod.start_mm
    radius2_mm2, inside = (0.5 * rod.diameter_mm) ** 2, np.zeros(seen.shape[1])
    for depth_mm in np.arange(low - rod.diameter_mm, high + rod.diameter_mm, _DEPTH_STEP_MM):
        along = along_rays * depth_mm - before_start
        inside += (_away2_mm2(seen * depth_mm, axis) <= radius2_mm2) & (along >= 0.0) & (along <= length)
    total = np.zeros(rays.shape[:2])
    total[near] = inside * _DEPTH_STEP_MM
    return total


def _ball_paths_mm(rays: NDArray[np.float64], balls: NDArray[np.float64]) -> NDArray[np.float64]:
    units, total = rays / np.linalg.norm(rays, axis=-1, keepdims=True), np.zeros(rays.shape[:2])
    for *centre, diameter_mm in balls.tolist():
        centre_mm = np.array(centre)
        square = (0.5 * diameter_mm) ** 2 - (centre_mm @ centre_mm - (units @ centre_mm) ** 2)
        total += 2.0 * np.sqrt(np.maximum(square, 0.0))
    return total


def turned(camera_from_nail: Transform[Camera, Nail], nail: NailPart, turn: CArmTurn) -> Transform[Camera, Nail]:
    """Where the nail is for a C-arm that was turned about the point midway between the holes."""
    middles = np.array([np.mean(hole_surface_points(nail, hole), axis=0) for hole in nail.holes])
    pivot = camera_from_nail @ np.asarray(middles.mean(axis=0))
    new_from_old = turn.rotation.T
    rotation = new_from_old @ camera_from_nail.rotation
    origin = new_from_old @ (camera_from_nail.translation_mm - pivot) + pivot
    return Transform.from_rotation_translation(rotation, origin)
