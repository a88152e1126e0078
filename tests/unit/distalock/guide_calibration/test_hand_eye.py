"""Guide calibration: exact without noise, honest with it, and what it must notice."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robot.guide_calibration import result_of
from benchmarks.robot.guide_rooms import EXTENSION_MM, Head, made_head, numerical_views
from distalock.guide_calibration.acceptance import GuideRefusalCode, check_calibration, head_setting
from distalock.guide_calibration.hand_eye import GuideView, calibrate_guide, view_residual
from distalock.guide_calibration.poses import suggested_poses
from shared.geometry.frames import Guide
from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.hexapod_limits import limit_violations
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod

HEXAPOD = default_hexapod()
NOMINAL = HEXAPOD.top_from_guide(EXTENSION_MM)
# What `suggested_poses` gives for nine images, to a tenth: choosing them takes seconds.
POSES = [
    PlatformPose.from_array(values)
    for values in (
        [-18.7, 14.9, 12.4, -14.0, -16.9, 7.9],
        [-7.7, 6.1, 6.3, 21.1, 0.5, 25.9],
        [12.2, 16.8, -15.1, -16.0, 8.8, 13.3],
        [-19.0, -15.6, 12.5, 7.7, -17.4, -16.3],
        [-3.3, 12.5, -0.4, 18.0, 6.5, 26.4],
        [-8.1, -4.5, 15.3, -19.9, -8.8, -24.1],
        [7.3, -17.6, -14.6, 14.9, 9.9, -17.2],
        [0.5, -15.4, -4.1, -18.7, 11.3, -26.4],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    )
]


def exact_views(head: Head, poses: list[PlatformPose]) -> list[GuideView]:
    world: NDArray[np.float64] = Transform.from_rotvec([0.2, -0.1, 0.3], [10.0, 20.0, -300.0]).matrix
    covariance = np.diag([1e-6] * 3 + [1e-4] * 3)
    return [
        GuideView(pose, world @ base_from_top(HEXAPOD, pose, HEXAPOD.pivot_mm).matrix @ head.matrix, covariance)
        for pose in poses
    ]


def turned(rotation_deg: tuple[float, float, float], shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Head:
    off: Transform[Guide, Guide] = Transform.from_rotvec(np.radians(rotation_deg), shift_mm)
    return NOMINAL @ off


def troubles(head: Head, views: list[GuideView] | None = None) -> set[GuideRefusalCode]:
    views = views or exact_views(head, POSES)
    found = calibrate_guide(HEXAPOD, views[:-1], NOMINAL)
    return {r.code for r in check_calibration(HEXAPOD, EXTENSION_MM, found, views[:-1], views[-1])}


def test_without_noise_the_head_is_found_exactly() -> None:
    head = turned((0.8, -0.5, 1.1), (0.4, -0.6, 0.9))
    views = exact_views(head, POSES)
    found = calibrate_guide(HEXAPOD, views[:-1], NOMINAL)
    np.testing.assert_allclose(found.top_from_guide.matrix, head.matrix, atol=1e-6)
    assert found.normalised_rms < 1e-3
    assert max(view_residual(HEXAPOD, found, views[-1])) < 1e-4
    assert troubles(head) == set()


def test_with_noise_the_covariance_is_honest() -> None:
    heads = {seed: made_head(HEXAPOD, seed) for seed in range(640, 652)}
    results = [result_of(HEXAPOD, h, numerical_views(HEXAPOD, h, POSES, s), s) for s, h in heads.items()]
    for result in results:
        print(result)
    normalised = float(np.mean([r.normalised for r in results]))
    assert 0.6 < normalised < 1.5
    assert np.median([r.error_mm for r in results]) < 0.1
    assert np.median([r.error_deg for r in results]) < 0.1


@pytest.mark.parametrize(
    ("head", "trouble"),
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
def test_a_wrong_extension_a_turned_and_a_bent_guide_are_told_apart(head: Head, trouble: GuideRefusalCode) -> None:
    assert troubles(head) == {trouble}


def test_a_guide_that_slipped_between_the_images_is_noticed() -> None:
    views = exact_views(NOMINAL, POSES)
    slipped = exact_views(turned((0.0, 1.5, 0.0), (0.0, 1.0, 0.0)), POSES)
    assert GuideRefusalCode.VIEWS_DISAGREE in troubles(NOMINAL, [*views[:4], *slipped[4:]])


def test_a_check_that_differs_is_told() -> None:
    views = exact_views(NOMINAL, POSES)
    other = exact_views(turned((1.0, 0.0, 0.0)), POSES)[-1]
    assert troubles(NOMINAL, [*views[:-1], other]) == {GuideRefusalCode.CHECK_POSE_DIFFERS}


def test_poses_that_turn_about_one_axis_alone_are_not_enough() -> None:
    poses = [PlatformPose(0.0, 0.0, 0.0, 0.0, 0.0, w) for w in (-12.0, -6.0, 0.0, 6.0, 12.0)]
    assert GuideRefusalCode.TOO_LITTLE_ROTATION in troubles(NOMINAL, exact_views(NOMINAL, [*poses, poses[2]]))


def test_poor_images_are_refused_by_their_uncertainty() -> None:
    views = [replace(v, covariance=400.0 * v.covariance) for v in exact_views(NOMINAL, POSES)]
    assert troubles(NOMINAL, views) == {GuideRefusalCode.UNCERTAIN}


def test_three_views_are_refused() -> None:
    with pytest.raises(ValueError, match="seen in 3 poses, 4 are needed; take more images"):
        calibrate_guide(HEXAPOD, exact_views(NOMINAL, POSES)[:3], NOMINAL)


def test_the_heads_setting_is_read_from_where_the_guide_is() -> None:
    head = head_setting(HEXAPOD, HEXAPOD.top_from_guide(72.5))
    assert (head.extension_mm, head.turned_deg, head.beside_mm) == pytest.approx((72.5, 0.0, 0.0), abs=1e-9)


def test_suggested_poses_can_be_reached_turn_enough_and_differ() -> None:
    poses = suggested_poses(HEXAPOD, EXTENSION_MM, 6)
    assert len(poses) == 6
    values = np.array([pose.as_array() for pose in poses])
    apart = np.linalg.norm(values[:, None] - values[None], axis=-1)
    assert apart[np.triu_indices(6, 1)].min() > 9.9
    assert all(limit_violations(HEXAPOD, pose, HEXAPOD.pivot_mm) == () for pose in poses)
    assert GuideRefusalCode.TOO_LITTLE_ROTATION not in troubles(NOMINAL, exact_views(NOMINAL, poses))
