"""Objects darker than the nail explains are found with a margin; noise, bright residuals and covered rims are not."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.foreign import foreign_pixels, rim_views
from services.registration.core.nail.imaging_chain import Sampling
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput, FitRegion, cut_region
from services.registration.core.tuning import FOREIGN_OBJECTS
from shared.xray.pixel_scale import pixels
from tests.unit.services.registration.xray_scene import calibration, nail_part, posed_nail

SIDE = 1024


def region() -> FitRegion:
    pixels = np.full((SIDE, SIDE), 1000.0, dtype=np.float32)
    cut = cut_region(
        FitInput(pixels, calibration(SIDE), nail_part(), Occluders(None, None)),
        posed_nail(0.0),
        6.0,
        Sampling(1, 0.0, 0.235),
    )
    assert cut is not None
    return cut


REGION = region()


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


def test_a_rim_is_seen_in_all_directions_unless_a_part_is_left_out() -> None:
    nail = nail_part()
    assert [view.share for view in rim_views(REGION, nail)] == [1.0] * len(nail.holes)
    hole = nail.holes[0]
    kept = ~((REGION.along_mm < hole.axis.point_mm[0]) & (np.abs(REGION.along_mm - hole.axis.point_mm[0]) < 8.0))
    covered = replace(
        REGION, along_mm=REGION.along_mm[kept], across_mm=REGION.across_mm[kept], compared=REGION.compared[kept]
    )
    first, *others = rim_views(covered, nail)
    assert 0.45 <= first.share <= 0.55
    assert all(view.share == 1.0 for view in others)
