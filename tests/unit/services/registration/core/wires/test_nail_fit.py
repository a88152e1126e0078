"""The nail behind wires, in a rendered lateral image; and what is said when it cannot be seen."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.fusion import ImageResult
from services.registration.core.guide.as_built import FocalLength
from services.registration.core.guide.locate import GuideFit
from services.registration.core.localise import LocalisationResult, Parts
from services.registration.core.wires.image import RegisteredImage
from services.registration.core.wires.nail_fit import (
    guide_tilt_deg,
    localise_nail_with_wires,
    locate_nail_near_guide_axes,
    no_holes_reasons,
    relocalise_with_wires,
)
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform
from tests.unit.services.registration.core.wires.wire_scene import (
    GUIDE_COVARIANCE,
    GUIDE_FROM_NAIL,
    LATERAL,
    SIZE_PX,
    WIRE_DIAMETER_MM,
    Wired,
    oblique,
)
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.xray_scene import AS_OF_A_TUBE, Scene, calibration, guide_part, nail_part, render

# Over the holes, but not along them: the wires' stubs and what sticks out of them cover a part of each.
OVER_THE_HOLES = Wired({"distal": np.array([0.4, -0.3, 1.0, -0.8]), "proximal": np.array([-0.3, 0.5, -0.4, 1.2])})
# The scene shows the guide's holes in no body: a fit that expects one would miss its edges.
PARTS = Parts(rendered_parts().ring, replace(guide_part(), body=()), nail_part(), USUAL_DRILL_DIAMETER_MM)


def guide_at(camera_from_guide: Transform[Camera, Guide]) -> GuideFit:
    used = np.ones(8, dtype=np.bool_)
    focal_length = FocalLength(0.0, 1e-6, 0.0)
    pose = PoseEstimate.of(camera_from_guide, GUIDE_COVARIANCE)
    return GuideFit(pose, used, np.zeros((8, 2)), np.full(8, 0.05), 8, 0.05, 8, focal_length)


@lru_cache(maxsize=1)
def lateral_pixels() -> NDArray[np.float32]:
    """With as much noise as hides that the scene's paths are sampled in steps of half a millimetre."""
    rods = OVER_THE_HOLES.rods(LATERAL, 112.0)
    scene = Scene(SIZE_PX, PARTS.nail, LATERAL @ GUIDE_FROM_NAIL, rods, noise=0.03, beam=AS_OF_A_TUBE)
    return render(scene, calibration(SIZE_PX), 71)


def registered(pixels: NDArray[np.float32]) -> RegisteredImage:
    return RegisteredImage(pixels, calibration(SIZE_PX), LATERAL, GUIDE_COVARIANCE)


def localised(pixels: NDArray[np.float32], reasons: tuple[Reason, ...], guide: GuideFit | None) -> ImageResult:
    result = LocalisationResult(reasons, guide, None, None, None, None)
    return ImageResult("lateral", pixels, calibration(SIZE_PX), result)


def test_the_start_is_near_though_wires_cover_the_holes() -> None:
    start = locate_nail_near_guide_axes(registered(lateral_pixels()), PARTS.guide, PARTS.nail)
    assert isinstance(start, Accepted), start
    off = GUIDE_FROM_NAIL.motion_to(LATERAL.inverse() @ start.value)
    print(f"start off by {np.degrees(off[:3]).round(2)} degrees, {off[3:].round(2)} mm")
    assert float(np.linalg.norm(off[3:5])) < 1.5
    assert float(np.degrees(np.linalg.norm(off[:3]))) < 5.0


@pytest.mark.slow
@pytest.mark.long
def test_the_nail_behind_wires_is_as_accurate_as_predicted() -> None:
    found = localise_nail_with_wires(registered(lateral_pixels()), PARTS, None, WIRE_DIAMETER_MM)
    assert isinstance(found, Accepted), found
    assert found.value.covariance is not None
    off = GUIDE_FROM_NAIL.motion_to(LATERAL.inverse() @ found.value.camera_from_nail)
    normalised = off / np.sqrt(np.diag(found.value.covariance))
    print(f"off by {np.degrees(off[:3]).round(3)} degrees, {off[3:].round(3)} mm, normalised {normalised.round(2)}")
    assert float(np.linalg.norm(off[3:5])) < 0.1
    assert float(np.degrees(np.linalg.norm(off[:2]))) < 0.6
    assert np.abs(normalised).max() < 3.5


def test_an_image_without_a_nail_is_refused() -> None:
    blank = np.full((SIZE_PX, SIZE_PX), 0.5, dtype=np.float32)
    found = localise_nail_with_wires(registered(blank), PARTS, None, WIRE_DIAMETER_MM)
    assert isinstance(found, Rejected)
    assert [reason.code for reason in found.reasons] == [ReasonCode.HOLE_NOT_VISIBLE]
    assert "within 18 mm of where the guide's holes point" in found.reasons[0].message


def test_an_image_from_aside_keeps_what_was_found() -> None:
    aside = guide_at(oblique(38.0))
    assert guide_tilt_deg(aside, PARTS) > 30.0
    image = localised(lateral_pixels(), (), aside)
    assert relocalise_with_wires(image, PARTS, WIRE_DIAMETER_MM) is image


def test_only_images_along_the_holes_tell_why_those_are_not_seen() -> None:
    covered = Reason(ReasonCode.HOLE_NOT_VISIBLE, "a hole is covered; uncover it")
    other = Reason(ReasonCode.NAIL_NOT_FOUND, "no nail; show it")
    blank = np.zeros((8, 8), np.float32)
    lateral = localised(blank, (covered,), guide_at(LATERAL))
    from_aside = localised(blank, (other,), guide_at(oblique(38.0)))
    told = no_holes_reasons((lateral, from_aside), PARTS)
    assert [reason.message for reason in told] == [
        "a hole is covered; uncover it; or add an image from before the wires"
    ]
    alone = no_holes_reasons((from_aside,), PARTS)
    assert [reason.code for reason in alone] == [ReasonCode.HOLE_NOT_VISIBLE]
    assert "tilted against the beam by 38° (limit 25°) or more; add an image along the wires" in alone[0].message
    assert no_holes_reasons((localised(blank, (other,), None),), PARTS) == (other,)


@pytest.mark.parametrize("tilt_deg", [38.0, 10.0, 0.0])
def test_the_guides_tilt_is_against_the_ray_to_the_nail(tilt_deg: float) -> None:
    assert guide_tilt_deg(guide_at(oblique(tilt_deg)), PARTS) == pytest.approx(tilt_deg, abs=0.1)
