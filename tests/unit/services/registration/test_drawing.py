"""The drawing as vectors: where the parts are, in the pixels of the image as received and of the corrected one."""

from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.localise import LocalisationResult, Parts, localise
from services.registration.drawing import image_drawing
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import DisplacementField
from shared.geometry.parts import hole_surface_points
from tests.unit.services.registration.core.test_fusion import NOTHING
from tests.unit.services.registration.rendered_case import SIZE_PX, Shown, rendered, rendered_parts
from tests.unit.services.registration.xray_scene import calibration

SHIFT_PX = np.array([7.0, -3.0])
Localised = tuple[Parts, CArmCalibration, LocalisationResult]


@pytest.fixture(scope="module")
def localised() -> Localised:
    pixels, view = rendered(Shown(), seed=7)
    return rendered_parts(), view, localise(pixels, view, rendered_parts())


def test_holes_balls_and_paths_lie_where_the_localisation_has_them(localised: Localised) -> None:
    parts, view, result = localised
    assert result.guide is not None
    assert result.nail is not None
    raw = image_drawing("a" * 64, view, result, parts).raw

    assert [ball.id for ball in raw.guide_balls] == list(parts.guide.balls.ids)
    used = [ball.residual_px for ball in raw.guide_balls if ball.residual_px is not None]
    assert len(used) == result.guide.balls_found
    assert np.sqrt(np.mean(np.square(used))) == pytest.approx(result.guide.reprojection_rms_px, rel=0.5)
    assert sum(ball.used for ball in raw.ring_balls) == view.balls_found

    for hole, part in zip(raw.holes, parts.nail.holes, strict=True):
        ends = view.image_from_camera(
            result.nail.camera_from_nail.points(np.stack(hole_surface_points(parts.nail, part)))
        )
        assert np.array(hole.axis_px[1:]) == pytest.approx(ends, abs=0.01)
        width_px = np.ptp(np.array(hole.rims_px[0]), axis=0).max()
        assert width_px * hole.mm_per_px == pytest.approx(part.diameter_mm, rel=0.05)
        assert view.pixel_mm > hole.mm_per_px  # the nail lies between focal spot and detector
    path = {one.id: one for one in raw.drill_paths}[parts.nail.holes[0].id]
    width_px = np.ptp(np.array(path.rims_px[0]), axis=0).max()
    assert width_px * raw.holes[0].mm_per_px == pytest.approx(parts.drill_diameter_mm, rel=0.1)


def test_ellipses_hold_as_much_as_the_covariance_says(localised: Localised) -> None:
    parts, view, result = localised
    assert result.holes is not None
    for hole, estimate in zip(image_drawing("a" * 64, view, result, parts).raw.holes, result.holes, strict=True):
        assert estimate.offset is not None
        assert hole.entry_95 is not None
        assert hole.exit_95 is not None
        major_mm = hole.entry_95.semi_major_px * hole.mm_per_px
        assert major_mm == pytest.approx(estimate.offset.entry_bound_mm, rel=0.1)
        assert hole.entry_95.centre_px == pytest.approx(hole.axis_px[1], abs=0.05)


def test_the_corrected_view_is_without_distortion() -> None:
    view = calibration(SIZE_PX)
    nodes = view.distortion.displacement_px
    distorted = replace(
        view,
        distortion=DisplacementField(
            view.distortion.origin_px,
            view.distortion.spacing_px,
            np.broadcast_to(SHIFT_PX, nodes.shape),
            view.distortion.standard_deviation_px,
        ),
    )
    drawing = image_drawing("a" * 64, distorted, NOTHING.result, rendered_parts())
    raw, corrected = (np.array([ball.centre_px for ball in one.ring_balls]) for one in (drawing.raw, drawing.corrected))
    assert corrected - raw == pytest.approx(np.broadcast_to(SHIFT_PX, raw.shape), abs=0.02)
