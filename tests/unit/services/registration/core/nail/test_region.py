"""Which pixels take part in the nail's fit."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.nail.imaging_chain import Sampling
from services.registration.core.nail.occluders import Occluders, Penumbra, PlacedGuide, SteelRod, steel_path_mm
from services.registration.core.nail.region import FitInput, FitRegion, cut_region
from shared.geometry.frames import Camera
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import USUAL_PIXEL_MM
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_GUIDE,
    CAMERA_FROM_NAIL,
    Shown,
    rendered,
    rendered_parts,
)
from tests.unit.services.registration.xray_scene import pincushion


def sampled(reduction: int) -> Sampling:
    return Sampling(reduction, smoothing_px=0.0, pixel_mm=USUAL_PIXEL_MM)


def region_with(hidden: tuple[slice, slice] | None, reduction: int) -> FitRegion:
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    occluders = Occluders(None, parts.ring)
    if hidden is not None:
        mask = np.zeros(pixels.shape, dtype=bool)
        mask[hidden] = True
        occluders = replace(occluders, hidden=mask)
    region = cut_region(FitInput(pixels, view, parts.nail, occluders), CAMERA_FROM_NAIL, 3.5, sampled(reduction))
    assert region is not None
    return region


@pytest.mark.parametrize("reduction", [1, 3])
def test_hidden_pixels_are_not_compared_and_all_others_are(reduction: int) -> None:
    whole = region_with(None, reduction)
    middle = whole.compared[len(whole.compared) // 2]
    row, column = (int(v) for v in np.unravel_index(middle, whole.shape))
    x, y = (round(o + reduction * at) for o, at in zip(whole.origin_px, (column, row), strict=True))
    hidden = (slice(y - 10, y + 11), slice(x - 10, x + 11))
    left_out = set(whole.compared) - set(region_with(hidden, reduction).compared)
    assert middle in left_out
    rows, columns = np.unravel_index(sorted(left_out), whole.shape)
    assert len(left_out) >= 0.9 * (21 // reduction) ** 2  # the strip may end nearby
    assert np.ptp(rows) <= 20 // reduction + 1
    assert np.ptp(columns) <= 20 // reduction + 1


@pytest.mark.parametrize("reduction", [1, 2, 3])
@pytest.mark.parametrize(("edge_fraction", "aside_mm"), [(0.0, 0.0), (0.08, 0.0), (0.08, 38.0)])
def test_steel_is_found_wherever_there_is_some(reduction: int, edge_fraction: float, aside_mm: float) -> None:
    """Looking only near balls and wires must miss nothing, also where distortion stretches the image."""
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    view = replace(view, distortion=pincushion(view.width_px, edge_fraction))
    aside: Transform[Camera, Camera] = Transform.from_rotvec(np.zeros(3), np.array([aside_mm, aside_mm, 0.0]))
    wire = SteelRod(np.array([-60.0, -31.0, 700.0]), np.array([65.0, 68.0, 760.0]), 3.0)
    occluders = Occluders(PlacedGuide(parts.guide, aside @ CAMERA_FROM_GUIDE), parts.ring, rods=(wire,))
    region = cut_region(
        FitInput(pixels, view, parts.nail, occluders), aside @ CAMERA_FROM_NAIL, 3.5, sampled(reduction)
    )
    assert region is not None
    penumbra = Penumbra.beside(view, float((aside @ CAMERA_FROM_NAIL).translation_mm[2]), reduction)
    everywhere = steel_path_mm(region.rays, occluders, view, penumbra)
    row, path_mm = region.steel
    assert np.array_equal(np.where(row[:, None] >= 0, path_mm[row], 0.0), everywhere)
    assert path_mm.any(axis=1).all()
    assert np.count_nonzero(everywhere) > 100


def test_only_where_the_guides_body_differs_from_its_usual_path_is_told_from_the_background() -> None:
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    occluders = Occluders(PlacedGuide(parts.guide, CAMERA_FROM_GUIDE), parts.ring)
    region = cut_region(FitInput(pixels, view, parts.nail, occluders), CAMERA_FROM_NAIL, 3.5, sampled(1))
    assert region is not None
    excess = region.delrin_excess_mm.ravel()[region.compared]
    assert np.median(excess) == 0.0
    thickness_mm = sum(box.size_mm[2] for box in parts.guide.body)
    assert excess.min() == pytest.approx(-thickness_mm, rel=0.05)  # through a bore
