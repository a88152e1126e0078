"""One C-arm that stands still has one focal spot: what the images say of it together moves what each says alone."""

from dataclasses import replace

import numpy as np

from distalock.guide_calibration.observations import GuideObservation, views_of_one_c_arm
from shared.geometry.frames import Guide, Ring
from shared.geometry.hexapod import ZERO_POSE
from shared.geometry.transform import Transform

SOURCE_MM = np.array([3.0, -4.0, -950.0])
PLACE_MM = np.array([10.0, 20.0, -330.0])
FIT = np.diag([1e-8] * 3 + [1e-6] * 3)


def observation(source_off_mm: tuple[float, float, float]) -> GuideObservation:
    """A guide as it seems when the image's own focal spot is off: its shadow on the ring stays where it was."""
    source_mm = SOURCE_MM + source_off_mm
    share = PLACE_MM[2] / SOURCE_MM[2]
    seen: Transform[Ring, Guide] = Transform.from_rotvec([0.1, -0.2, 0.3], PLACE_MM + share * (source_mm - SOURCE_MM))
    return GuideObservation(ZERO_POSE, seen, FIT, source_mm, np.diag([4e-4, 4e-4, 0.15]))


def test_images_that_differ_in_their_focal_spot_alone_agree_with_one() -> None:
    views = views_of_one_c_arm([observation((0.0, 0.0, z)) for z in (-0.6, 0.1, 0.5)])
    for view in views:
        np.testing.assert_allclose(view.fixed_from_guide[:3, 3], PLACE_MM, atol=2e-3)


def test_a_focal_spot_that_is_known_better_counts_more() -> None:
    good, poor = observation((0.0, 0.0, 0.0)), observation((0.0, 0.0, 1.0))
    poor = replace(poor, source_covariance_mm2=100.0 * poor.source_covariance_mm2)
    views = views_of_one_c_arm([good, poor])
    np.testing.assert_allclose(views[1].fixed_from_guide[:3, 3], PLACE_MM, atol=0.02)


def test_the_covariance_holds_the_common_focal_spot_and_a_tilt_that_no_fit_knows() -> None:
    one, nine = (views_of_one_c_arm([observation((0.0, 0.0, 0.0))] * count)[0] for count in (1, 9))
    rotation = one.fixed_from_guide[:3, :3]
    along = rotation.T @ [0.0, 0.0, 1.0]
    depth_mm2 = [along @ v.covariance[3:, 3:] @ along - 1e-6 for v in (one, nine)]
    np.testing.assert_allclose(depth_mm2, [0.15 * (330.0 / 950.0) ** 2, 0.15 * (330.0 / 950.0) ** 2 / 9.0], rtol=1e-6)
    turn_rad2 = along @ one.covariance[:3, :3] @ along
    np.testing.assert_allclose(turn_rad2, 1e-8, rtol=1e-6)
    assert np.linalg.eigvalsh(one.covariance[:3, :3])[1] > np.radians(0.02) ** 2


def test_no_images_give_no_views() -> None:
    assert views_of_one_c_arm([]) == ()
