"""What is left out of a fit: cut off pixels, stubs of wires in openings, objects darker than the nail explains."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.left_out import (
    around_holes,
    beyond_foreign,
    clipped_pixels,
    covered_pixels,
    foreign_pixels,
)
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from services.registration.core.nail.search.find import find_nail
from services.registration.core.tuning import FOREIGN_OBJECTS
from shared.errors import Accepted
from shared.xray.pixel_scale import pixels
from tests.unit.services.registration.core.nail.whole_region import REGION, SIDE
from tests.unit.services.registration.xray_scene import Rod, Scene, calibration, nail_part, posed_nail, render

NOISE = 2.0
SIZE_PX = 560
NAIL, POSE = nail_part(), posed_nail(40.0)
NO_DISCS = np.zeros((0, 3))


def ramp() -> NDArray[np.float32]:
    """Grey values that rise by one noise deviation every ten columns, from far below the cut at 100."""
    level = 80.0 + NOISE * np.arange(200) / 10.0
    return np.asarray(level + np.random.default_rng(3).normal(0.0, NOISE, (60, 200)), dtype=np.float32)


def test_an_image_that_is_not_cut_off_loses_nothing() -> None:
    assert not clipped_pixels(ramp()).any()


def test_pixels_are_left_out_up_to_where_noise_is_hardly_cut_off() -> None:
    clipped = clipped_pixels(np.maximum(ramp(), 100.0).astype(np.float32))
    share = clipped[5:-5].mean(axis=0)
    assert share[:100].min() == 1.0, "at the cut and below"
    assert share[105:112].min() > 0.9, "one noise deviation above it"
    assert share[135:].max() < 0.05, "beyond three"


def covered(
    known: NDArray[np.float64], rods: tuple[Rod, ...] = (), balls: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    view = calibration(SIZE_PX)
    there = np.zeros((0, 4)) if balls is None else balls
    image = render(Scene(SIZE_PX, NAIL, POSE, rods, there, texture=0.03), view, seed=51)
    start = find_nail(image, view, NAIL)
    assert isinstance(start, Accepted), start
    return covered_pixels(image, view, start.value.openings, 740.0, known)


def stub() -> tuple[Rod, NDArray[np.float64]]:
    """A wire that ends at the rim of the distal hole, and where its end appears in the image."""
    points = POSE.points(np.array([[15.5, 2.4, -6.0], [16.5, 4.5, -110.0]]))
    return Rod(points[0], points[1], 2.0), calibration(SIZE_PX).image_from_camera(points[:1])[0]


def test_a_wires_stub_is_covered_with_its_surroundings() -> None:
    rod, (x, y) = stub()
    mask = covered(NO_DISCS, rods=(rod,))
    assert mask[round(y), round(x)]
    proximal_x, proximal_y = calibration(SIZE_PX).image_from_camera(POSE.points(np.array([[-15.0, 0.0, 0.0]])))[0]
    assert not mask[round(proximal_y), round(proximal_x)]
    # The stub, less than a wire's width inside the rim, and 1.45 mm around it: no more than a third of an opening more.
    assert 100 < np.count_nonzero(mask) < 1500


def test_clear_openings_are_not_covered() -> None:
    assert not covered(NO_DISCS).any()


def test_a_ball_is_covered_unless_it_is_known() -> None:
    # On the ray to the opening, 110 mm nearer to the source.
    place = POSE.points(np.array([[15.0, 1.5, 0.0]])) * (630.0 / 740.0)
    ball = np.column_stack([place, [2.0]])
    x, y = calibration(SIZE_PX).image_from_camera(place)[0]
    assert covered(NO_DISCS, balls=ball)[round(y), round(x)]
    assert not covered(np.array([[x, y, 6.7]]), balls=ball).any()


def residual(step: float, radius_px: float) -> NDArray[np.float64]:
    """Noise of deviation 1 with a disc of another brightness in the middle of the region."""
    noise = np.random.default_rng(4).normal(0.0, 1.0, len(REGION.compared))
    rows, columns = np.divmod(REGION.compared, REGION.shape[1])
    middle = REGION.shape[0] // 2, REGION.shape[1] // 2
    return np.asarray(noise + step * (np.hypot(rows - middle[0], columns - middle[1]) < radius_px))


def found(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    return foreign_pixels(REGION, values, np.ones_like(values), (SIDE, SIDE))


def test_a_dark_object_is_found_where_it_is_with_a_margin() -> None:
    mask = found(residual(-6.0, 6.0))
    y, x = np.nonzero(mask)
    left, top = REGION.origin_px
    assert abs(x.mean() - left - REGION.shape[1] // 2) < 1.0
    assert abs(y.mean() - top - REGION.shape[0] // 2) < 1.0
    radius_px = np.sqrt(mask.sum() / np.pi)
    assert 6.0 < radius_px < 6.0 + 2.0 * pixels(FOREIGN_OBJECTS.margin_detector_mm, 0.235)


def test_noise_bright_spots_and_specks_are_not_foreign() -> None:
    assert not found(residual(0.0, 0.0)).any()
    assert not found(residual(6.0, 6.0)).any()
    assert not found(residual(-8.0, 0.8)).any()


def test_what_lies_beyond_an_object_beside_the_nail_is_left_out_and_the_nail_is_not() -> None:
    rows, columns = np.divmod(REGION.compared, REGION.shape[1])
    left, top = (int(v) for v in REGION.origin_px)
    strip = np.zeros((SIDE, SIDE), dtype=bool)
    on_strip = np.abs(REGION.across_mm - (NAIL.radius_mm + 1.0)) < 0.3
    strip[rows[on_strip] + top, columns[on_strip] + left] = True
    beyond = beyond_foreign(REGION, NAIL, strip)[rows + top, columns + left]
    assert beyond[REGION.across_mm > NAIL.radius_mm + 1.0].all()
    assert not beyond[REGION.across_mm < NAIL.radius_mm + 0.6].any()


def test_surroundings_of_the_holes_lie_inside_the_nails_edges() -> None:
    view = calibration(SIZE_PX)
    around = around_holes(FitInput(np.zeros((SIZE_PX, SIZE_PX), np.float32), view, NAIL, Occluders(None, None)), POSE)
    radius_px = 0.5 * NAIL.holes[0].diameter_mm * view.camera.focal_length_px / float(POSE.translation_mm[2])
    assert np.count_nonzero(around) > 2 * np.pi * (1.3 * radius_px) ** 2
    edge = POSE.points(np.array([[x, y, 0.0] for x in (-15.0, 15.0) for y in (-NAIL.radius_mm, NAIL.radius_mm)]))
    assert not any(around[round(y), round(x)] for x, y in view.image_from_camera(edge))
