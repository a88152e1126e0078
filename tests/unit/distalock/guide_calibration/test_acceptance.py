"""What a calibration is refused for: each defect has its own code."""

from dataclasses import replace

import pytest

from distalock.guide_calibration.acceptance import GuideRefusalCode, head_setting
from shared.geometry.hexapod import PlatformPose
from tests.unit.distalock.guide_calibration.views import HEXAPOD, NOMINAL, POSES, Head, codes, exact_views, turned


@pytest.mark.parametrize(
    ("head", "code"),
    [
        (HEXAPOD.top_from_guide(70.0), GuideRefusalCode.HEAD_EXTENSION),
        (HEXAPOD.top_from_guide(50.0), GuideRefusalCode.HEAD_EXTENSION),
        (turned((0.0, 0.0, 180.0)), GuideRefusalCode.GUIDE_TURNED),
        (turned((180.0, 0.0, 0.0)), GuideRefusalCode.GUIDE_TURNED),
        (turned((0.0, 0.0, 90.0)), GuideRefusalCode.GUIDE_TURNED),
        (turned((3.0, 0.0, 0.0)), GuideRefusalCode.GUIDE_BENT),
        (turned((0.0, 0.0, 0.0), (0.0, 2.0, 2.0)), GuideRefusalCode.GUIDE_BENT),
    ],
)
def test_a_wrong_extension_a_turned_and_a_bent_guide_have_codes_of_their_own(
    head: Head, code: GuideRefusalCode
) -> None:
    assert codes(head) == {code}


def test_a_guide_that_slipped_between_the_images_is_noticed() -> None:
    views = exact_views(NOMINAL, POSES)
    slipped = exact_views(turned((0.0, 1.5, 0.0), (0.0, 1.0, 0.0)), POSES)
    assert GuideRefusalCode.VIEWS_DISAGREE in codes(NOMINAL, [*views[:4], *slipped[4:]])


def test_a_check_that_differs_is_refused() -> None:
    views = exact_views(NOMINAL, POSES)
    other = exact_views(turned((1.0, 0.0, 0.0)), POSES)[-1]
    assert codes(NOMINAL, [*views[:-1], other]) == {GuideRefusalCode.CHECK_POSE_DIFFERS}


def test_poses_that_turn_about_one_axis_alone_are_not_enough() -> None:
    poses = [PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, w) for w in (-12.0, -6.0, 0.0, 6.0, 12.0)]
    assert GuideRefusalCode.TOO_LITTLE_ROTATION in codes(NOMINAL, exact_views(NOMINAL, [*poses, poses[2]]))


def test_poor_images_are_refused_by_their_uncertainty() -> None:
    views = [replace(v, covariance=400.0 * v.covariance) for v in exact_views(NOMINAL, POSES)]
    assert codes(NOMINAL, views) == {GuideRefusalCode.UNCERTAIN}


def test_the_heads_setting_is_read_from_where_the_guide_is() -> None:
    head = head_setting(HEXAPOD, HEXAPOD.top_from_guide(72.5))
    assert (head.extension_mm, head.turned_deg, head.beside_mm) == pytest.approx((72.5, 0.0, 0.0), abs=1e-9)
