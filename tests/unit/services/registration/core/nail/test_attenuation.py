"""What passes the nail, against stepping along the rays, and its derivatives, against differences."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from services.registration.core.nail.attenuation import (
    BY_CHAMFER,
    BY_HARDENING,
    BY_HOLE_RADIUS,
    BY_LOG_ATTENUATION,
    BY_NAIL_RADIUS,
    DERIVATIVES,
    MOTION_SIZE,
    TraceLimits,
    trace_pixels,
    transmission_behind,
)
from services.registration.core.nail.rays import SAMPLES_PX, NailShape, PixelRays, SteelPaths
from services.registration.core.tuning import BEAM, RAY_SAMPLING
from shared.geometry.frames import Camera, Nail
from shared.geometry.transform import Transform
from simulation.render.attenuation import Material, attenuation_per_mm, spectrum

HARDEST = BEAM.hardest_share
LIMITS = TraceLimits(
    RAY_SAMPLING.edge_reach_px,
    RAY_SAMPLING.uniform_difference,
    RAY_SAMPLING.softening_px,
    RAY_SAMPLING.near_edge_in_steps,
)
CENTRE_ONLY = np.zeros((4, 2))
BORES = np.array([[15.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 5.6], [-15.0, 0.5, 0.0, 0.0, 0.2, np.sqrt(0.96), 2.5, 5.7]])
# Both drawn out along the nail; a deep chamfer of a hole that leans to it is not traced to its ends.
SLOTS = np.array(
    [[[15.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 5.6, 2.0], [-15.0, 0.5, 0.0, 0.1, 0.2, np.sqrt(0.95), 2.5, 6.0, 1.5]]]
)
ROTATION = np.ascontiguousarray(Rotation.from_euler("zyx", [40.0, 4.0, -6.0], degrees=True).as_matrix())
PLACE = np.array([3.0, -2.0, 740.0])

PATHS_MM = np.concatenate([np.linspace(0.0, 1.0, 30), np.linspace(1.0, 13.0, 60)])
CORTEX_MM = 10.0


def directions(seed: int, count: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-22.0, 22.0, count), rng.uniform(-7.0, 7.0, count)
    points = np.column_stack([along, across, np.zeros(count)]) @ ROTATION.T + PLACE
    return np.ascontiguousarray(points[:, :2] / points[:, 2:])


def no_steel(count: int) -> SteelPaths:
    return SteelPaths(np.full(count, -1), np.zeros((0, len(SAMPLES_PX))))


def transmitted(
    rays: NDArray[np.float64], cannulation_mm: float, bores: NDArray[np.float64] = BORES
) -> NDArray[np.float64]:
    none = np.zeros_like(rays)
    out, derivatives = np.empty(len(rays)), np.empty((len(rays), DERIVATIVES), dtype=np.float32)
    nail = NailShape(ROTATION, PLACE, 6.0, cannulation_mm, bores, (0.1, 0.0, HARDEST), 1.0)
    trace_pixels(PixelRays(rays, none, none), CENTRE_ONLY, no_steel(len(rays)), nail, LIMITS, out, derivatives)
    return out


def stepped_length(
    rays: NDArray[np.float64], cannulation_mm: float, bores: NDArray[np.float64] = BORES
) -> NDArray[np.float64]:
    step = 0.005
    depths = np.arange(725.0, 755.0, step)
    lengths = []
    for x, y in rays:
        ray = np.array([x, y, 1.0])
        p = (depths[:, None] * ray - PLACE) @ ROTATION
        radius = np.hypot(p[:, 1], p[:, 2])
        metal = (radius < 6.0) & (radius > cannulation_mm)
        for bore in bores.reshape(-1, bores.shape[-1]):
            off = p - bore[:3]
            off -= np.outer(off @ bore[3:6], bore[3:6])
            long = np.array([1.0, 0.0, 0.0]) - bore[3] * bore[3:6]
            long /= np.linalg.norm(long)
            half = bore[8] if len(bore) > 8 else 0.0
            off -= np.outer(np.clip(off @ long, -half, half), long)
            aside = np.linalg.norm(off, axis=1)
            along = np.abs((p - bore[:3]) @ bore[3:6])
            metal &= (aside > bore[6]) & (aside - bore[6] > along - bore[7])
        lengths.append(np.count_nonzero(metal) * step * np.linalg.norm(ray))
    return np.array(lengths)


@pytest.mark.parametrize("cannulation_mm", [0.0, 2.2])
def test_metal_is_cylinder_less_bores_less_cannulation(cannulation_mm: float) -> None:
    rays = directions(4, 60)
    length = -np.log(transmitted(rays, cannulation_mm)) / 0.1
    assert np.abs(length - stepped_length(rays, cannulation_mm)).max() < 0.05
    assert np.count_nonzero(length < 1e-9) > 2  # some rays pass through a bore or beside the nail


@pytest.mark.parametrize("cannulation_mm", [0.0, 2.2])
def test_a_slot_is_two_bores_and_what_lies_between_them(cannulation_mm: float) -> None:
    rays = directions(7, 60)
    length = -np.log(transmitted(rays, cannulation_mm, SLOTS)) / 0.1
    assert np.abs(length - stepped_length(rays, cannulation_mm, SLOTS)).max() < 0.05
    wider = length < -np.log(transmitted(rays, cannulation_mm)) / 0.1 - 1.0
    assert np.count_nonzero(wider) > 2


def test_pixels_beside_steel_are_sampled_more_finely() -> None:
    rays = directions(4, 1)
    beside = np.ascontiguousarray(rays + np.array([[1.0, 0.0]]))  # far beside the nail, at its middle
    right = np.ascontiguousarray(rays - beside)  # but half a pixel further lies the nail
    places = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    out, derivatives = np.empty(1), np.empty((1, DERIVATIVES), dtype=np.float32)
    path_mm = np.full((1, len(places)), 1e3)
    path_mm[:, :3] = 0.0
    nail = NailShape(ROTATION, PLACE, 6.0, 0.0, BORES, (0.1, 0.0, HARDEST), 1.0)
    beside_steel = SteelPaths.of_pixels(1, np.zeros(1, dtype=np.int64), path_mm)
    for steel, pixel, expected in ((beside_steel, right, 3.0 / 8.0), (no_steel(1), 0.01 * right, 1.0)):
        rays_beside = PixelRays(beside, pixel, np.zeros((1, 2)))
        trace_pixels(rays_beside, places, steel, nail, LIMITS, out, derivatives)
        assert out[0] == pytest.approx(expected)


def test_steel_counts_as_so_much_of_the_nails_material() -> None:
    beside = np.array([[0.2, 0.0]])  # far beside the nail
    out, derivatives = np.empty(1), np.empty((1, DERIVATIVES), dtype=np.float32)
    steel = SteelPaths.of_pixels(1, np.zeros(1, dtype=np.int64), np.full((1, len(CENTRE_ONLY)), 2.0))
    nail = NailShape(ROTATION, PLACE, 6.0, 0.0, BORES, (0.1, 0.0, HARDEST), 1.7)
    trace_pixels(PixelRays(beside, 0.0 * beside, 0.0 * beside), CENTRE_ONLY, steel, nail, LIMITS, out, derivatives)
    assert out[0] == pytest.approx(np.exp(-0.1 * 1.7 * 2.0))


SLOT_IN_PICTURE = np.array([[[15.0, 0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 5.1, 1.5]]])

COLUMNS, ROWS, PIXEL = 110, 100, 0.22 / 1000.0

BLUR_PX = 1.2

STEPS = {k: 0.004 if k < 3 else 0.02 for k in range(MOTION_SIZE)} | {
    5: 0.2,
    BY_HOLE_RADIUS: 0.02,
    BY_NAIL_RADIUS: 0.02,
    BY_CHAMFER: 0.04,
    BY_LOG_ATTENUATION: 0.02,
    BY_HARDENING: 0.01,
}


def rays_of_picture() -> PixelRays:
    """Through all pixels of the picture."""
    x, y = np.meshgrid(np.arange(COLUMNS) - 0.5 * COLUMNS, np.arange(ROWS) - 0.5 * ROWS)
    slopes = PIXEL * np.column_stack([x.ravel(), y.ravel()])
    steps = np.full((len(slopes), 1), PIXEL)
    return PixelRays(slopes, np.hstack([steps, 0.0 * steps]), np.hstack([0.0 * steps, steps]))


def nail_in_picture(cannulation_mm: float, *, slot: bool = False) -> NailShape:
    """A nail that is tilted by 3 and 5 degrees, its first hole in the middle."""
    pose = Rotation.from_euler("zyx", [25.0, 3.0, -5.0], degrees=True).as_matrix()
    return NailShape(
        np.ascontiguousarray(pose),
        np.array([0.0, 0.0, 640.0]) - pose @ [15.0, 0.0, 0.0],
        5.5,
        cannulation_mm,
        SLOT_IN_PICTURE if slot else SLOT_IN_PICTURE[0, :, :8].copy(),
        (0.33, 0.7, HARDEST),
        1.0,
    )


def blurred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(gaussian_filter(values.reshape(ROWS, COLUMNS), BLUR_PX))


def traced(nail: NailShape, *, all_finely: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rays = rays_of_picture()
    count = len(rays.slopes)
    transmission, derivatives = np.empty(count), np.empty((count, DERIVATIVES), dtype=np.float32)
    # steel so thin that it does not count has its pixels looked at finely all the same
    everywhere = SteelPaths(np.arange(count), np.zeros((count, len(SAMPLES_PX))))
    trace_pixels(
        rays, SAMPLES_PX, everywhere if all_finely else no_steel(count), nail, LIMITS, transmission, derivatives
    )
    return transmission, derivatives.astype(np.float64)


@pytest.mark.parametrize("cannulation_mm", [0.0, 2.2])
def test_the_middle_stands_for_a_pixel_only_away_from_edges(cannulation_mm: float) -> None:
    nail = nail_in_picture(cannulation_mm)
    for cause in range(DERIVATIVES):
        other = moved(nail, cause, 10.0 * STEPS[cause])
        transmission, finely = traced(other)[0], traced(other, all_finely=True)[0]
        assert np.abs(transmission - finely).max() < 0.005
        assert np.sqrt(np.mean((transmission - finely) ** 2)) < 4e-4


def moved(nail: NailShape, cause: int, by: float) -> NailShape:
    if cause < MOTION_SIZE:
        motion = np.eye(MOTION_SIZE)[cause] * by
        pose = Transform[Camera, Nail].from_rotation_translation(nail.rotation, nail.translation_mm)
        pose = pose @ Transform[Nail, Nail].from_rotvec(motion[:3], motion[3:])
        return nail._replace(rotation=np.ascontiguousarray(pose.rotation), translation_mm=np.array(pose.translation_mm))
    if cause == BY_HOLE_RADIUS:
        return nail._replace(bores=nail.bores + by * np.eye(nail.bores.shape[-1])[6])
    if cause == BY_NAIL_RADIUS:  # the chamfer's depth stays the same
        return nail._replace(radius_mm=nail.radius_mm + by, bores=nail.bores + by * np.eye(nail.bores.shape[-1])[7])
    if cause == BY_CHAMFER:
        return nail._replace(bores=nail.bores - by * np.eye(nail.bores.shape[-1])[7])
    attenuation, hardening, hardest = nail.material
    if cause == BY_LOG_ATTENUATION:
        return nail._replace(material=(attenuation * float(np.exp(by)), hardening, hardest))
    return nail._replace(material=(attenuation, hardening + by, hardest))


@pytest.mark.parametrize("cannulation_mm", [0.0, 2.2])
@pytest.mark.parametrize("cause", range(DERIVATIVES))
@pytest.mark.parametrize("slot", [False, True])
def test_derivatives_agree_with_differences_over_a_tenth_of_a_pixel(
    cause: int, cannulation_mm: float, *, slot: bool
) -> None:
    nail, step = nail_in_picture(cannulation_mm, slot=slot), STEPS[cause]
    sides = [blurred(traced(moved(nail, cause, side * step))[0]) for side in (0.5, -0.5)]
    expected = (sides[0] - sides[1]) / step
    found = blurred(traced(nail)[1][:, cause])
    size = float(np.sum(expected**2))
    assert float(np.sum(expected * found)) / size == pytest.approx(1.0, abs=0.03)
    assert float(np.sum((expected - found) ** 2)) / size < 0.1**2


def law(paths_mm: NDArray[np.float64], attenuation: float, hardening: float) -> NDArray[np.float64]:
    return np.array([transmission_behind(path, (attenuation, hardening, HARDEST))[0] for path in paths_mm])


@pytest.mark.parametrize("metal", [Material.TITANIUM, Material.STEEL])
@pytest.mark.parametrize("kilovolts", [64.0, 76.0])
@pytest.mark.parametrize("muscle_mm", [100.0, 200.0])
def test_the_law_holds_for_the_x_rays_of_a_tube_behind_a_thigh(
    metal: Material, kilovolts: float, muscle_mm: float
) -> None:
    """A quarter of a per cent along a hole's rim already turns a titanium nail by 0.1 degrees."""
    beam = spectrum(kilovolts, 4.0, bins=40)
    muscle = attenuation_per_mm(Material.MUSCLE, beam.energy_kev)
    bone = attenuation_per_mm(Material.CORTICAL_BONE, beam.energy_kev)
    behind = beam.weight * np.exp(-muscle * muscle_mm - bone * CORTEX_MM)
    # the nail takes the place of tissue
    per_mm = attenuation_per_mm(metal, beam.energy_kev) - muscle
    true = np.exp(-np.outer(PATHS_MM, per_mm)) @ behind / behind.sum()
    best, _ = curve_fit(law, PATHS_MM, true, p0=(float(per_mm @ behind / behind.sum()), 0.65))
    assert 0.3 < best[1] < 1.1
    assert np.abs(law(PATHS_MM, *best) - true).max() < 0.0015


@pytest.mark.parametrize("hardening", [0.0, 0.0005, 0.002, 0.3, 1.5])
@pytest.mark.parametrize("path_mm", [0.01, 0.8, 9.0])
def test_derivatives_are_those_of_the_law(hardening: float, path_mm: float) -> None:
    attenuation, step = 0.5, 1e-4
    _, by_depth, by_hardening = transmission_behind(path_mm, (attenuation, hardening, HARDEST))
    sides = [transmission_behind(path_mm * np.exp(s), (attenuation, hardening, HARDEST))[0] for s in (step, -step)]
    assert by_depth == pytest.approx((sides[0] - sides[1]) / (2.0 * step), rel=1e-5)
    above, here = (
        transmission_behind(path_mm, (attenuation, max(hardening, 0.001) + h, HARDEST))[0] for h in (0.01, 0.0)
    )
    assert by_hardening == pytest.approx((above - here) / 0.01, rel=0.05)


def test_nothing_is_lost_without_metal_and_nothing_passes_much() -> None:
    assert transmission_behind(0.0, (1.6, 0.65, HARDEST)) == (1.0, 0.0, 0.0)
    assert transmission_behind(200.0, (1.6, 0.65, HARDEST))[0] < 1e-30
