"""Where the mount's screws are advised: within the head's reach, beside one another, where the image shows it."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.localise import localise
from services.registration.core.mounting_site import MountingSite, mounting_site, site_of_nail
from services.registration.drawing import image_drawing
from services.registration.overlay import overlay_png
from services.registration.report import mounting_site_message
from shared.geometry.frames import Camera, Nail
from shared.geometry.hexapod_mount import BoneScrews
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.registration.core.test_fusion import NOTHING
from tests.unit.services.registration.rendered_case import SIZE_PX, Shown, rendered, rendered_parts
from tests.unit.services.registration.xray_scene import calibration, posed_nail

HEXAPOD = default_hexapod()
VIEW = calibration(SIZE_PX)


def towards_the_middle(distal_mm: float) -> Transform[Camera, Nail]:
    """The nail along the image's rows, its holes to the right of the image's middle."""
    return posed_nail(0.0, (1.0, -1.0), (distal_mm, 0.0, 740.0))


def advised(distal_mm: float, spacing_mm: float = 25.0) -> MountingSite:
    hexapod = replace(HEXAPOD, bone_screws=BoneScrews(spacing_mm, 5.0))
    return mounting_site(VIEW, towards_the_middle(distal_mm), rendered_parts().nail, hexapod)


def test_the_middle_of_the_heads_range_is_advised_where_the_image_shows_it() -> None:
    site = advised(45.0)
    assert site.shown
    assert site.head_extension_mm == 60.0
    assert [screw.proximal_mm for screw in site.screws] == [47.5, 72.5]
    surface_mm = rendered_parts().nail.radius_mm
    for screw in site.screws:
        expected = towards_the_middle(45.0).points(np.array([[-screw.proximal_mm, 0.0, -surface_mm]]))
        assert screw.axis_px[1] == pytest.approx(VIEW.image_from_camera(expected)[0])
        beam_deg = abs(np.degrees(np.arctan2(45.0 - screw.proximal_mm, 740.0)))
        assert screw.tilt_to_ray_deg == pytest.approx(beam_deg, abs=np.hypot(1.0, 1.0))


@pytest.mark.parametrize(("distal_mm", "spacing_mm"), [(20.0, 25.0), (75.0, 20.0), (0.0, 30.0)])
def test_screws_stay_within_the_heads_reach(distal_mm: float, spacing_mm: float) -> None:
    site = advised(distal_mm, spacing_mm)
    distal, proximal = site.screws
    assert proximal.proximal_mm - distal.proximal_mm == pytest.approx(spacing_mm)
    assert HEXAPOD.head_extension_mm.contains(distal.proximal_mm)
    assert HEXAPOD.head_extension_mm.contains(proximal.proximal_mm)
    assert site.head_extension_mm == pytest.approx(0.5 * (distal.proximal_mm + proximal.proximal_mm))


def test_the_nearest_place_that_the_image_shows_is_advised() -> None:
    """The image ends where the proximal screw would be: the distal end of the range still fits."""
    places = {distal_mm: advised(distal_mm) for distal_mm in np.arange(0.0, 40.0, 2.0).tolist()}
    shown = {distal_mm: site.head_extension_mm for distal_mm, site in places.items() if site.shown}
    assert 52.5 <= min(shown.values()) < 60.0
    assert max(shown.values()) == 60.0
    assert places[0.0].head_extension_mm == 60.0  # nothing fits: the middle, and that it is not shown
    assert not places[0.0].shown


def test_an_image_of_the_nail_alone_is_advised_on_and_drawn() -> None:
    pixels, view = rendered(Shown(guide=None), seed=3)
    parts = rendered_parts()
    result = localise(pixels, view, parts)
    assert result.guide is None
    site = site_of_nail(result, view, parts, HEXAPOD)
    assert site is not None
    message = mounting_site_message(site)
    assert [screw.id for screw in message.screws] == ["distal", "proximal"]
    assert message.screws[0].at_nail_px == tuple(site.screws[0].axis_px[1])
    with_site = overlay_png(pixels, view, result, parts, site)
    assert with_site != overlay_png(pixels, view, result, parts)
    drawing = image_drawing("a" * 64, view, result, parts, site).raw
    for drawn, screw in zip(drawing.mounting_screws, site.screws, strict=True):
        assert np.array(drawn.axis_px) == pytest.approx(screw.axis_px, abs=0.01)
    assert [hole.entry_95 for hole in drawing.holes] == [None, None]  # offsets are against a guide
    assert not drawing.drill_paths
    assert not drawing.guide_balls


def test_nothing_is_advised_without_a_nail() -> None:
    assert site_of_nail(NOTHING.result, VIEW, rendered_parts(), HEXAPOD) is None
