"""Several images of one set-up: what they show together, and contradictions told for what they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from services.registration.core.c_arm_advice import c_arm_correction_deg
from services.registration.core.estimation.joint import fuse, leave_one_out
from services.registration.core.estimation.pose_estimate import model_loadings
from services.registration.core.fusion import ImageResult, fuse_localisations
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.localise import LocalisationResult, Parts, hole_estimates
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.core.estimation.stated_estimates import (
    DEPTH_SD_MM,
    POSE,
    Estimate,
    across_mm,
    evidence,
    shifted,
    told,
)
from tests.unit.services.registration.core.test_hole_axes import GUIDE_POSE, KNOWN_SOURCE, NAIL_POSE, guide_fit
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.stated_errors import errors_without_shape
from tests.unit.services.registration.xray_scene import guide_part, nail_part


def test_one_image_says_what_it_said() -> None:
    one = evidence()
    joint = fuse((one,))
    assert joint.pose.mean.matrix == pytest.approx(POSE.matrix)
    assert joint.pose.covariance == pytest.approx(one.covariance)
    assert joint.chi_square == pytest.approx(0.0)
    assert joint.degrees_of_freedom == 0


def test_two_directions_show_the_depth() -> None:
    lateral, oblique = evidence(), evidence((38.0, 0.0))
    alone, joint = fuse((lateral,)), fuse((lateral, oblique))
    assert np.sqrt(alone.pose.covariance[5, 5]) == pytest.approx(DEPTH_SD_MM, rel=0.01)
    # across the oblique ray the nail is known to 0.03 mm: seen from there, that is depth over the angle's sine
    assert np.sqrt(joint.pose.covariance[5, 5]) < 2.0 * 0.03 / np.sin(np.radians(38.0))
    moved = shifted(lateral, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.8]))
    found = fuse((moved, oblique)).pose.mean
    assert abs(POSE.motion_to(found)[5]) < 0.05


def message(images: tuple[Estimate, ...]) -> str:
    reason = told(images)
    assert reason is not None
    assert reason.code is ReasonCode.IMAGES_DISAGREE
    assert "limit" in reason.message
    return reason.message


AGREEING = (evidence((2.0, 0.0)), evidence((-4.0, 1.0)), evidence((0.0, 6.0)), evidence((3.0, 3.0)))
MOVED = across_mm(1.1, -0.4)


def test_images_within_their_errors_agree() -> None:
    assert told(AGREEING) is None
    assert told((AGREEING[0], shifted(AGREEING[1], across_mm(0.05, 0.0)))) is None
    assert told(AGREEING[:1]) is None


def test_depth_along_the_ray_may_differ_by_what_one_image_cannot_tell() -> None:
    assert told((evidence(), shifted(evidence((0.0, 5.0)), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.6])))) is None


def test_two_images_cannot_tell_which_is_wrong() -> None:
    words = message((AGREEING[0], shifted(AGREEING[1], MOVED)))
    assert "two images cannot tell which" in words
    assert "differs by 1.17 mm at its entry" in words
    assert "take one more image" in words


def test_the_image_in_the_middle_is_the_odd_one() -> None:
    words = message((AGREEING[0], shifted(AGREEING[1], MOVED), *AGREEING[2:]))
    assert words.startswith("image 2 is the odd one")
    assert "leave it out" in words


def test_the_last_image_is_odd_or_the_guide_moved_before_it() -> None:
    words = message((*AGREEING[:2], shifted(AGREEING[2], MOVED)))
    assert words.startswith("image 3, taken after all others, is the odd one")
    assert "between it and image 2" in words


def test_the_first_image_is_odd_or_the_guide_moved_after_it() -> None:
    words = message((shifted(AGREEING[0], MOVED), *AGREEING[1:3]))
    assert words.startswith("image 1, taken before all others, is the odd one")
    assert "between it and image 2" in words


def test_a_guide_that_moved_parts_the_images_in_time() -> None:
    words = message((*AGREEING[:2], *(shifted(image, MOVED) for image in AGREEING[2:])))
    assert words.startswith("the guide moved on the bone between images 2 and 3")
    assert "use only the images after it" in words


@pytest.mark.requirement("REG-07")
def test_a_loose_guide_lets_no_images_agree() -> None:
    places = (across_mm(0.0, 0.0), across_mm(1.5, 0.0), across_mm(0.0, 1.5), across_mm(-1.5, 0.5))
    words = message(tuple(shifted(image, place) for image, place in zip(AGREEING, places, strict=True)))
    assert "no images of the 4 agree" in words


@pytest.mark.requirement("REG-04")
@pytest.mark.parametrize("count", [2, 3])
def test_a_guide_of_another_size_is_told_from_one_that_moved(count: int) -> None:
    """A guide 1 % larger than its file, about 600 mm away: the nail appears 6 mm too far away, along each ray."""
    rays = [np.zeros(3) if image.errors.ray is None else image.errors.ray for image in AGREEING[:count]]
    farther = [np.concatenate([np.zeros(3), 6.0 * ray]) for ray in rays]
    words = message(tuple(shifted(image, way) for image, way in zip(AGREEING[:count], farther, strict=True)))
    scale = 0.01 * float(words.split("the guide is ")[1].split(" %")[0])
    guide_mm = np.linalg.norm((NAIL_POSE @ POSE.inverse()).translation_mm)
    assert scale == pytest.approx(1.0 + 6.0 / guide_mm, abs=0.002)
    assert ("measure the guide and take one more image" if count == 2 else "measure one of its lengths") in words


def test_images_from_nearly_one_direction_say_nothing_of_the_guides_size() -> None:
    along = np.array([0.0, 0.0, 0.0, 0.0, 0.7, 0.0])
    words = message((evidence((2.0, 0.0)), shifted(evidence((2.2, 0.0)), along)))
    assert "two images cannot tell which" in words
    assert "as large as its file" not in words


def test_the_odd_one_raises_chi_square_most() -> None:
    influence = leave_one_out((AGREEING[0], shifted(AGREEING[1], MOVED), AGREEING[2]))
    assert int(np.argmax(influence)) == 1


BLANK = np.ones((8, 8), np.float32)
PARTS = Parts(rendered_parts().ring, guide_part(), nail_part(), USUAL_DRILL_DIAMETER_MM)


def localised(name: str, moved_mm: float = 0.0, spread: float = 1.0, *reasons: Reason) -> ImageResult:
    """An image by a known camera; the nail moved across the beam, and its fit's standard deviations spread."""
    fit_covariance = block_diag(np.eye(3) * np.radians(0.05) ** 2, np.diag([0.02, 0.02, 0.2]) ** 2) * spread**2
    step: Transform[Nail, Nail] = Transform.from_rotvec(np.zeros(3), [moved_mm, 0.0, 0.0])
    pose = NAIL_POSE @ step
    guide = guide_fit(GUIDE_POSE, np.eye(6) * 1e-8)
    errors = errors_without_shape(fit_covariance, model_loadings(PARTS.nail, pose))
    nail = NailEstimate(pose, errors, 100.0)
    holes = hole_estimates(KNOWN_SOURCE, PARTS, guide, nail)
    correction = c_arm_correction_deg(pose, PARTS.nail)
    guide_from_nail = GUIDE_POSE.inverse() @ pose
    result = LocalisationResult(reasons, guide, nail, guide_from_nail, holes, correction)
    return ImageResult(name, BLANK, KNOWN_SOURCE, result)


UNCERTAIN = Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, "too uncertain; more dose")
AMBIGUOUS = Reason(ReasonCode.MIRROR_AMBIGUOUS, "two tilts; turn the C-arm")
NO_RING = LocalisationResult((Reason(ReasonCode.RING_NOT_FOUND, "no ring; show it"),), None, None, None, None, None)
NOTHING = ImageResult("empty", BLANK, None, NO_RING)


def test_good_images_are_joined_and_the_newest_is_shown() -> None:
    fused = fuse_localisations((localised("a"), localised("b", 0.02)), PARTS)
    assert fused is not None
    assert fused.result.accepted
    assert fused.shown == 1
    assert [share.used for share in fused.shares] == [True, True]
    assert fused.result.guide_from_nail is not None
    between = (GUIDE_POSE.inverse() @ NAIL_POSE).motion_to(fused.result.guide_from_nail)
    assert between[3] == pytest.approx(0.01, abs=1e-3)
    assert 0.0 < fused.chi_square < fused.chi_square_limit


def test_uncertain_images_are_used_and_others_are_not() -> None:
    images = (localised("a", 0.0, 1.0, UNCERTAIN), NOTHING, localised("b", 0.0, 1.0, AMBIGUOUS), localised("c"))
    fused = fuse_localisations(images, PARTS)
    assert fused is not None
    assert [share.used for share in fused.shares] == [True, False, False, True]
    assert fused.shown == 3
    assert fused.result.accepted


def test_images_too_uncertain_together_stay_refused() -> None:
    fused = fuse_localisations((localised("a", 0.0, 30.0), localised("b", 0.0, 30.0)), PARTS)
    assert fused is not None
    assert {reason.code for reason in fused.result.reasons} == {ReasonCode.UNCERTAINTY_TOO_LARGE}


def test_images_too_uncertain_by_displaced_balls_ask_for_the_guide() -> None:
    first, second = (localised(name, 0.0, 30.0) for name in ("a", "b"))
    assert second.result.guide is not None
    displaced = replace(second.result, guide=replace(second.result.guide, displacement_sd_mm=0.15))
    fused = fuse_localisations((first, replace(second, result=displaced)), PARTS)
    assert fused is not None
    assert len(fused.result.reasons) == len(PARTS.nail.holes)
    for reason in fused.result.reasons:
        assert (
            "the guide's balls lie 0.15 mm (rms per axis) from where its file has them; measure the guide"
            in reason.message
        )


@pytest.mark.requirement("REG-07")
def test_contradicting_images_keep_the_newest_but_refuse_it() -> None:
    fused = fuse_localisations((localised("a"), localised("b", 2.0)), PARTS)
    assert fused is not None
    assert [reason.code for reason in fused.result.reasons] == [ReasonCode.IMAGES_DISAGREE]
    assert "images a and b" in fused.result.reasons[0].message


def test_no_usable_image_leaves_nothing_to_join() -> None:
    assert fuse_localisations((NOTHING, localised("b", 0.0, 1.0, AMBIGUOUS)), PARTS) is None
