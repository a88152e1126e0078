"""Guide and nail from images with wires: the nail's outline ties them together, and names a guide half out of view."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.estimation.joint import fuse
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guide.locate import locate_guide
from services.registration.core.wires.image import RegisteredImage
from services.registration.core.wires.joint_estimate import JointRegistration, joint_registration, update_with_outline
from services.registration.core.wires.nail_outline import (
    locate_guide_given_nail,
    match_nail_outline,
    nail_outline,
    smooth_image,
)
from services.registration.core.wires.verify import estimate_jointly
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform
from shared.xray.detection import detect_balls
from tests.unit.services.registration.core.test_fusion import NOTHING, localised
from tests.unit.services.registration.core.test_fusion import PARTS as FUSION_PARTS
from tests.unit.services.registration.core.wires.wire_scene import (
    ALONG_THE_GUIDE,
    GUIDE_COVARIANCE,
    GUIDE_FROM_NAIL,
    LATERAL,
    oblique,
    view_of,
)
from tests.unit.services.registration.rendered_case import CAMERA_FROM_GUIDE, CAMERA_FROM_NAIL
from tests.unit.services.registration.rendered_case import SIZE_PX as CASE_SIZE_PX
from tests.unit.services.registration.rendered_case import rendered_parts as parts_of_the_case
from tests.unit.services.registration.xray_scene import Scene, calibration, guide_part, nail_part, render

OBLIQUE = oblique(38.0)
NAIL_COVARIANCE = np.diag([np.radians(0.2) ** 2, np.radians(0.2) ** 2, np.radians(0.02) ** 2, 0.03**2, 0.03**2, 0.5**2])


def blank_view() -> RegisteredImage:
    view = calibration(CASE_SIZE_PX)
    return RegisteredImage(np.zeros((8, 8), np.float32), view, OBLIQUE, GUIDE_COVARIANCE)


def displaced(view: RegisteredImage, error_mm: tuple[float, float, float]) -> RegisteredImage:
    """The view with its guide elsewhere than it is."""
    step: Transform[Guide, Guide] = Transform.from_rotvec(np.zeros(3), error_mm)
    return replace(view, camera_from_guide=view.camera_from_guide @ step)


def alone(view: RegisteredImage) -> JointRegistration:
    return JointRegistration((view,), GUIDE_FROM_NAIL, block_diag(view.guide_covariance * 9.0, NAIL_COVARIANCE))


def at_the_nail(estimate: JointRegistration, true_pose: Transform[Camera, Guide]) -> tuple[float, float]:
    """How far the nail is off in the image's plane, across its axis (mm), and what is predicted of that."""
    true = true_pose @ GUIDE_FROM_NAIL
    across = np.cross(true.directions(np.array([1.0, 0.0, 0.0])), [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    assumed_nail = estimate.camera_from_nail(0)
    J = across @ assumed_nail.rotation @ np.hstack([np.zeros((3, 3)), np.eye(3)])
    chained = np.hstack([estimate.guide_from_nail.inverse().adjoint, np.eye(6)])
    sd_mm = float(np.sqrt(J @ chained @ estimate.covariance @ chained.T @ J))
    return abs(float(across @ (assumed_nail.translation_mm - true.translation_mm))), sd_mm


def test_the_outline_is_where_the_image_has_the_nails_edges() -> None:
    view = view_of(OBLIQUE, ALONG_THE_GUIDE, seed=51)
    outline = nail_outline(view, nail_part(), OBLIQUE @ GUIDE_FROM_NAIL)
    match = match_nail_outline(smooth_image(view, guide_part()), outline, 4.0)
    assert match.found_fraction > 0.85
    for side in (0, 1):
        assert abs(float(np.median(match.residual_px[outline.side[match.index] == side]))) < 0.5


def test_the_outline_corrects_a_guide_that_is_displaced_elsewhere() -> None:
    view = displaced(view_of(OBLIQUE, ALONG_THE_GUIDE, seed=52), (0.0, 0.35, 0.0))
    before_mm, before_sd_mm = at_the_nail(alone(view), OBLIQUE)
    after_mm, after_sd_mm = at_the_nail(update_with_outline(alone(view), 0, guide_part(), nail_part())[0], OBLIQUE)
    print(f"off by {before_mm:.3f} ({before_sd_mm:.3f}) mm before, {after_mm:.3f} ({after_sd_mm:.3f}) mm after")
    assert before_mm > 0.2
    assert after_mm < 0.06
    assert after_sd_mm < 0.06 < before_sd_mm


def displaced_after(slip: Transform[Guide, Guide], view: RegisteredImage) -> JointRegistration:
    """What an image from before says of a set-up whose guide has slipped since."""
    covariance = block_diag(view.guide_covariance, NAIL_COVARIANCE)
    return JointRegistration((view,), slip @ GUIDE_FROM_NAIL, covariance)


def slip_of(turn_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> Transform[Guide, Guide]:
    return Transform.from_rotvec(np.radians(turn_deg), shift_mm)


NO_SLIP = slip_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@lru_cache(maxsize=1)
def lateral_view() -> RegisteredImage:
    return view_of(LATERAL, ALONG_THE_GUIDE, seed=53)


def test_an_untouched_estimate_is_not_refused_by_its_outline() -> None:
    innovation = update_with_outline(displaced_after(NO_SLIP, lateral_view()), 0, guide_part(), nail_part())[1]
    print(f"chi-square {innovation.chi_square:.1f}, {100.0 * innovation.found_fraction:.0f} % of the outline")
    assert innovation.reason("3") is None
    assert innovation.chi_square < 14.0  # of two degrees of freedom: one in a thousand is larger


@pytest.mark.requirement("REG-07")
@pytest.mark.parametrize(
    "slip",
    [
        slip_of((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        slip_of((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        slip_of((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    ],
    ids=["1 mm across the nail", "1 degree about the nail", "1 degree about the beam"],
)
def test_a_guide_that_slipped_since_the_holes_were_seen_is_refused(slip: Transform[Guide, Guide]) -> None:
    reason = update_with_outline(displaced_after(slip, lateral_view()), 0, guide_part(), nail_part())[1].reason("3")
    assert reason is not None
    assert reason.code is ReasonCode.IMAGES_DISAGREE
    assert reason.message.startswith("in image 3 ")
    assert "limit" in reason.message
    assert reason.message.endswith("check that mount and guide are tight, and take all images again")


def test_a_slip_of_one_millimetre_is_told_in_millimetres() -> None:
    slip = slip_of((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    innovation = update_with_outline(displaced_after(slip, lateral_view()), 0, guide_part(), nail_part())[1]
    assert abs(float(innovation.motion[0])) == pytest.approx(1.0, abs=0.2)
    assert innovation.found_fraction > 0.8


def test_a_nail_that_is_nowhere_near_shows_no_outline() -> None:
    away = slip_of((0.0, 0.0, 0.0), (0.0, 25.0, 0.0))
    reason = update_with_outline(displaced_after(away, lateral_view()), 0, guide_part(), nail_part())[1].reason("3")
    assert reason is not None
    assert "% (at least 60 %) of the nail's outline is where the guide in it" in reason.message


def test_what_an_image_said_of_the_nail_has_its_guides_error_in_it() -> None:
    guide_covariance = GUIDE_COVARIANCE
    by_guide = GUIDE_FROM_NAIL.inverse().adjoint
    stated = PoseEstimate.of(GUIDE_FROM_NAIL, by_guide @ guide_covariance @ by_guide.T)
    view = blank_view()
    estimate = joint_registration((view,), fuse((stated,)), (0,))
    chained = np.hstack([by_guide, np.eye(6)])
    # all of the nail's error is the guide's: together they leave none in the image
    assert np.abs(chained @ estimate.covariance @ chained.T).max() < 1e-12
    apart = joint_registration((view,), fuse((stated,)), (None,))
    assert np.abs(chained @ apart.covariance @ chained.T).max() > 1e-3


def test_a_covariance_of_the_wrong_size_is_refused() -> None:
    view = blank_view()
    with pytest.raises(ValueError, match="expected a covariance of shape"):
        JointRegistration((view,), GUIDE_FROM_NAIL, np.eye(6))


TRUE_GUIDE_FROM_NAIL: Transform[Guide, Nail] = CAMERA_FROM_GUIDE.inverse() @ CAMERA_FROM_NAIL


def with_few_balls(count: int) -> tuple[NDArray[np.float32], CArmCalibration]:
    """The nail, and the first few of the guide's balls: the others are out of view."""
    parts, view = parts_of_the_case(), calibration(CASE_SIZE_PX)
    pattern = parts.guide.balls
    balls = np.column_stack([CAMERA_FROM_GUIDE.points(pattern.position_mm), pattern.diameter_mm])[:count]
    pixels = render(Scene(CASE_SIZE_PX, parts.nail, CAMERA_FROM_NAIL, balls=balls), view, 61)
    return pixels, replace(view, balls=detect_balls(pixels, np.ones(pixels.shape, dtype=bool), (3.5, 9.0)))


def test_a_guide_that_shows_few_balls_is_named_by_where_it_puts_the_nail() -> None:
    pixels, view = with_few_balls(10)
    parts = parts_of_the_case()
    assert isinstance(locate_guide(pixels, view, parts.ring, parts.guide), Rejected)
    found = locate_guide_given_nail(pixels, view, parts, TRUE_GUIDE_FROM_NAIL)
    assert isinstance(found, Accepted), found
    assert 7 <= found.value.balls_found <= 10
    between = found.value.camera_from_guide.inverse() @ CAMERA_FROM_GUIDE
    assert float(np.linalg.norm(between.translation_mm[:2])) < 0.1


def test_a_nail_said_to_be_elsewhere_names_no_guide() -> None:
    pixels, view = with_few_balls(10)
    away: Transform[Guide, Guide] = Transform.from_rotvec(np.radians([0.0, 0.0, 60.0]), np.zeros(3))
    found = locate_guide_given_nail(pixels, view, parts_of_the_case(), away @ TRUE_GUIDE_FROM_NAIL)
    assert isinstance(found, Rejected)
    assert [reason.code for reason in found.reasons] == [ReasonCode.GUIDE_NOT_FOUND]
    assert "% (at least 55 %) of the nail on metal" in found.reasons[0].message


def test_images_that_show_no_axes_make_no_estimate() -> None:
    seen = estimate_jointly((NOTHING,), (), parts_of_the_case())
    assert seen.estimate is None
    assert seen.reasons == NOTHING.result.reasons


def test_an_earlier_image_that_contradicts_is_told() -> None:
    seen = estimate_jointly((localised("wired", 2.0),), (localised("before"),), FUSION_PARTS)
    assert seen.estimate is None
    assert [reason.code for reason in seen.reasons] == [ReasonCode.IMAGES_DISAGREE]
    assert "images before and wired" in seen.reasons[0].message
