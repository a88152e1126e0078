"""A small fluoroscope for testing the nail's fit: what it does to the picture is not what the fit assumes.

Three X-ray energies, scatter, a glare halo, quantum noise that the detector blurs, a square-root display and unsharp
masking with a wider mask than the fit expects; metal by the distance between skew lines, Delrin by sampled depth.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from services.registration.core.nail.occluders import Occluders, PlacedGuide
from shared.geometry.calibration import BallCandidates, CArmCalibration
from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole, Material, NailPart
from shared.geometry.transform import Transform
from tests.kept import kept

SIZE_PX = 330
FOCAL_PX = 4200.0
PHOTONS_PER_PIXEL = 2500.0
_OVERSAMPLING = 4
_BAND_ROWS_PX = 5
_ENERGIES = np.array([0.3, 0.4, 0.3])
_PER_MM: dict[Material, NDArray[np.float64]] = {
    "steel": np.array([2.1, 1.2, 0.8]),
    "Ti6Al4V": np.array([0.66, 0.40, 0.26]),
}
_DELRIN_PER_MM = 0.027
_BORE_DIAMETER_MM, _BLOCK_MM = 8.0, 15.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An image with all that a fit is given, and the truth."""

    pixels: NDArray[np.float32]
    calibration: CArmCalibration
    nail: NailPart
    occluders: Occluders
    camera_from_nail: Transform[Camera, Nail]


def nail_part(material: Material, diameter_mm: float, hole_mm: float, cannulation_mm: float = 0.0) -> NailPart:
    """A nail with two parallel holes 30 mm apart."""
    holes = tuple(
        Hole(name, Line(np.array([x, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])), hole_mm)
        for name, x in (("distal", 15.0), ("proximal", -15.0))
    )
    return NailPart(material, diameter_mm, cannulation_mm, 38.0, holes, "")


def posed(pitch_deg: float, roll_deg: float, turn_deg: float) -> Transform[Camera, Nail]:
    """A nail 740 mm from the focal spot, a few mm beside the optical axis, tilted about its own axes."""
    turn = Rotation.from_euler("z", turn_deg, degrees=True) * Rotation.from_euler(
        "yx", [pitch_deg, roll_deg], degrees=True
    )
    return Transform.from_rotation_translation(turn.as_matrix(), [3.0, -4.0, 740.0])


def calibration() -> CArmCalibration:
    """A C-arm without distortion whose optical axis passes 20 pixels beside the image's middle."""
    K = np.array([[FOCAL_PX, 0.0, 0.5 * SIZE_PX + 20.0], [0.0, FOCAL_PX, 0.5 * SIZE_PX - 10.0], [0.0, 0.0, 1.0]])
    none = np.zeros(0)
    no_balls = BallCandidates(np.zeros((0, 2)), none, none, none, np.zeros(0, dtype=np.int64))
    return CArmCalibration(
        SIZE_PX,
        SIZE_PX,
        False,
        PinholeCamera(K),
        Transform.from_rotation_translation(np.eye(3), [0.0, 0.0, 950.0]),
        DisplacementField.zero(SIZE_PX, SIZE_PX),
        np.eye(3),
        no_balls,
        0,
        0.0,
        0.0,
        0.0,
        None,
    )


def placed_guide(over_nail_mm: tuple[float, float], camera_from_nail: Transform[Camera, Nail]) -> PlacedGuide:
    """A Delrin block with a bore and three balls, 107 mm in front of the nail, its bore beside the distal hole."""
    bore = Hole("distal", Line(np.zeros(3), np.array([0.0, 0.0, 1.0])), _BORE_DIAMETER_MM)
    positions = np.array([[-3.2, 2.5, 10.0], [-14.0, 2.0, 10.0], [-28.5, 5.5, -10.0]])
    balls = BallPattern(("a", "b", "c"), positions, np.full(3, 2.0))
    part = GuidePart(balls, (bore,), (Box((0.0, 0.0, 0.0), (70.0, 40.0, _BLOCK_MM)),), "")
    hole = camera_from_nail @ np.array([15.0, 0.0, 0.0])
    place = hole * (633.0 / hole[2]) + np.array([*over_nail_mm, 0.0])
    return PlacedGuide(part, Transform.from_rotation_translation(camera_from_nail.rotation, place))


@kept
def shoot(
    nail: NailPart,
    camera_from_nail: Transform[Camera, Nail],
    guide_beside_mm: tuple[float, float],
    seed: int,
    dose: float = 1.0,
) -> Shot:
    """Take an image; `guide_beside_mm` places the guide's bore relative to the distal hole's ray."""
    rng = np.random.default_rng(seed)
    guide = placed_guide(guide_beside_mm, camera_from_nail)
    view = calibration()
    passed = np.concatenate([_passed(rays, nail, camera_from_nail, guide) for rays in _bands_of_rays(view)])
    intensity = passed * _tissue(rng)
    intensity = 0.94 * intensity + 0.06 * gaussian_filter(intensity, 40.0) + 0.12
    photons = PHOTONS_PER_PIXEL * dose
    noisy = gaussian_filter(intensity, 0.9) + gaussian_filter(rng.normal(0.0, np.sqrt(intensity / photons) * 1.8), 1.0)
    displayed = 60000.0 * np.sqrt(np.clip(gaussian_filter(noisy, 0.6), 0.0, None))
    displayed += 0.45 * (displayed - gaussian_filter(displayed, 2.2))
    return Shot(displayed.astype(np.float32), view, nail, Occluders(guide, None), camera_from_nail)


def _bands_of_rays(view: CArmCalibration) -> Iterator[NDArray[np.float64]]:
    """Rays through an image, several to a pixel, some rows at a time so that they stay in the processor's caches."""
    fine = (np.arange(SIZE_PX * _OVERSAMPLING) + 0.5) / _OVERSAMPLING - 0.5
    K = view.camera.intrinsic_matrix_px
    for band in fine.reshape(-1, _BAND_ROWS_PX * _OVERSAMPLING):
        x, y = np.meshgrid((fine - K[0, 2]) / FOCAL_PX, (band - K[1, 2]) / FOCAL_PX)
        yield np.stack([x, y, np.ones_like(x)], axis=-1)


def _passed(
    directions: NDArray[np.float64], nail: NailPart, camera_from_nail: Transform[Camera, Nail], guide: PlacedGuide
) -> NDArray[np.float64]:
    """What passes nail and guide, as the mean of each pixel."""
    metal = _nail_path(directions, nail, camera_from_nail)
    steel = _ball_path(directions, guide.camera_from_guide.points(guide.part.balls.position_mm))
    delrin = np.exp(-_DELRIN_PER_MM * _delrin_path(directions, guide))
    return _binned(_transmitted(metal, nail.material, steel) * delrin)


def _transmitted(
    metal_mm: NDArray[np.float64], material: Material, steel_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    total = np.zeros_like(metal_mm)
    for share, nail_per_mm, ball_per_mm in zip(_ENERGIES, _PER_MM[material], _PER_MM["steel"], strict=True):
        total += share * np.exp(-nail_per_mm * metal_mm - ball_per_mm * steel_mm)
    return total


def _tissue(rng: np.random.Generator) -> NDArray[np.float64]:
    """Bone of uneven density with a denser band across the picture, as transmission."""
    grain = sum(
        weight * width * gaussian_filter(rng.normal(size=(SIZE_PX, SIZE_PX)), width)
        for weight, width in ((0.02, 3.0), (0.05, 8.0), (0.1, 25.0))
    )
    across = np.arange(SIZE_PX)[:, None] + 0.3 * np.arange(SIZE_PX)[None, :]
    band = 0.25 * np.exp(-0.5 * ((across - rng.uniform(100.0, 300.0)) / 12.0) ** 2)
    return np.asarray(np.exp(-0.7 - grain - band))


def _binned(image: NDArray[np.float64]) -> NDArray[np.float64]:
    rows, columns = (size // _OVERSAMPLING for size in image.shape)
    return np.asarray(image.reshape(rows, _OVERSAMPLING, columns, _OVERSAMPLING).mean(axis=(1, 3)))


def _inside_cylinder(
    directions: NDArray[np.float64], point: NDArray[np.float64], axis: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depths z between which rays from the origin are inside a cylinder, by the distance between skew lines."""
    normal = np.cross(directions, axis)
    sine2 = (normal**2).sum(axis=-1)
    distance = (normal @ point) / np.sqrt(sine2)
    middle = (np.cross(point, axis) * normal).sum(axis=-1) / sine2
    half = np.sqrt(np.clip(radius**2 - distance**2, 0.0, None) / sine2)
    return middle - half, middle + half


def _nail_path(
    directions: NDArray[np.float64], nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    x_axis = camera_from_nail.rotation[:, 0]
    origin = camera_from_nail.translation_mm
    near, far = _inside_cylinder(directions, origin, x_axis, nail.radius_mm)
    spans = [
        _inside_cylinder(
            directions,
            camera_from_nail @ h.axis.point_mm,
            camera_from_nail.directions(h.axis.direction),
            0.5 * h.diameter_mm,
        )
        for h in nail.holes
    ]
    if nail.cannulation_diameter_mm > 0.0:
        spans.append(_inside_cylinder(directions, origin, x_axis, 0.5 * nail.cannulation_diameter_mm))
    empty = _union_length([(np.maximum(a, near), np.minimum(b, far)) for a, b in spans])
    length = (far - near - empty) * np.linalg.norm(directions, axis=-1)
    return np.asarray(np.clip(length, 0.0, None))


def _union_length(spans: list[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Length covered by any of the intervals, by sweeping them in order of their begins."""
    begins = np.stack([np.where(b > a, a, 0.0) for a, b in spans])
    ends = np.stack([np.where(b > a, b, 0.0) for a, b in spans])
    order = np.argsort(begins, axis=0)
    begins, ends = np.take_along_axis(begins, order, axis=0), np.take_along_axis(ends, order, axis=0)
    reached = np.full(begins.shape[1:], -np.inf)
    total = np.zeros(begins.shape[1:])
    for a, b in zip(begins, ends, strict=True):
        total += np.clip(b - np.maximum(a, reached), 0.0, None)
        reached = np.maximum(reached, b)
    return total


def _ball_path(directions: NDArray[np.float64], centres_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    units = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    path = np.zeros(directions.shape[:-1])
    for centre in centres_mm:
        off2 = (centre**2).sum() - (units @ centre) ** 2
        path += 2.0 * np.sqrt(np.clip(1.0 - off2, 0.0, None))
    return path


def _delrin_path(directions: NDArray[np.float64], guide: PlacedGuide) -> NDArray[np.float64]:
    guide_from_camera: Transform[Guide, Camera] = guide.camera_from_guide.inverse()
    spot, inside = guide_from_camera.translation_mm, guide_from_camera.directions(directions)
    heights = np.linspace(-0.5 * _BLOCK_MM, 0.5 * _BLOCK_MM, 12, endpoint=False) + 0.5 * _BLOCK_MM / 12.0
    length = np.zeros(directions.shape[:-1])
    for z in heights:
        where = spot + inside * ((z - spot[2]) / inside[..., 2])[..., None]
        solid = (np.abs(where[..., 0]) < 35.0) & (np.abs(where[..., 1]) < 20.0)
        length += solid & (np.hypot(where[..., 0], where[..., 1]) > 0.5 * _BORE_DIAMETER_MM)
    return length * (_BLOCK_MM / len(heights))
