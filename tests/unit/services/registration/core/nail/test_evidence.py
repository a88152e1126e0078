"""Parts that pull against one another enlarge the covariance, and only they; covered rims are known as such."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from services.registration.core.estimation.pose_estimate import PoseErrors
from services.registration.core.nail.evidence import Agreement, pull_ratio, rim_shares, scale_and_shape
from services.registration.core.nail.parameters import PARAMETER_COUNT, Parameter
from services.registration.core.tuning import AGREEMENT_OF_PARTS
from shared.geometry.lines import displacement_by_motion
from tests.unit.services.registration.core.nail.whole_region import REGION
from tests.unit.services.registration.xray_scene import nail_part

VARIANCES = np.full((26, 8), 0.01)


def test_pulls_of_the_predicted_size_change_nothing() -> None:
    generator = np.random.default_rng(8)
    ratios = [pull_ratio(generator.normal(0.0, 0.1, VARIANCES.shape), VARIANCES) for _ in range(200)]
    # eight offsets of 26 parts: the worst of them is beyond one by chance
    assert np.median(ratios) < 1.4
    assert np.quantile(ratios, 0.99) < 2.0


def test_pulls_three_times_as_large_are_nine_times_the_variance() -> None:
    pulls = 0.3 * np.ones_like(VARIANCES)
    assert pull_ratio(pulls, VARIANCES) == pytest.approx((4.0 + 26.0 * 9.0) / 30.0)


def test_one_part_that_has_nearly_all_the_weight_proves_little() -> None:
    variances = VARIANCES * 1e-6
    variances[0] = 0.01
    pulls = np.sqrt(variances)
    pulls[0] *= 2.0
    assert pull_ratio(pulls, variances) == pytest.approx((4.0 + 4.0) / 5.0, rel=1e-3)


NO_TURN = np.zeros((2, 2))
USUAL = Agreement(1.0, 0.1, 0.7, 0.7, 0.003, 4.0, 1.3, 2.0, 0.5, 1.05, NO_TURN, NO_TURN, NO_TURN)
ERRORS = PoseErrors(np.zeros(3), np.eye(9), np.zeros((9, 3)), np.zeros((9, 1)))
NAIL = nail_part()


def test_what_plain_images_show_changes_nothing() -> None:
    assert USUAL.variance_ratio == 1.0


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(
    ("symptom", "value", "ratio"),
    [
        ("pull_ratio", 3.0, 3.0),
        ("bulge", 0.3, 2.0),
        ("bulge", 0.9, 3.25),
        ("shape_at_scale", 1.0, 2.0),
        ("softness", 2.3, 2.0),
        ("sharpening", 3.0, 2.0),
        ("metal", 0.7, 5.0),
        ("tails", 2.1, 4.0),
    ],
)
def test_each_symptom_of_processing_enlarges_the_variance(symptom: str, value: float, ratio: float) -> None:
    changed: dict[str, Any] = {symptom: value}
    assert replace(USUAL, **changed).variance_ratio == pytest.approx(ratio)


def test_symptoms_add_and_the_pulls_multiply() -> None:
    assert replace(USUAL, pull_ratio=3.0, bulge=0.3, shape_at_scale=1.0).variance_ratio == pytest.approx(9.0)


def test_heavy_tails_are_the_least_that_an_image_counts_as_filtered() -> None:
    assert replace(USUAL, pull_ratio=3.0, tails=2.1).variance_ratio == pytest.approx(4.0)
    assert replace(USUAL, pull_ratio=5.0, tails=2.1).variance_ratio == pytest.approx(5.0)


def test_a_scale_of_nail_and_holes_is_a_symptom_only_where_a_filter_shows() -> None:
    scaled = replace(USUAL, shape=1.0, shape_at_scale=0.1)
    assert scaled.variance_ratio == 1.0
    assert replace(scaled, tails=1.06).variance_ratio == pytest.approx(2.0)


def test_noise_that_stays_correlated_is_a_symptom_only_where_a_filter_shows() -> None:
    smooth = replace(USUAL, noise_inflation=6.6)
    assert smooth.variance_ratio == 1.0
    assert replace(smooth, tails=1.06).variance_ratio == pytest.approx(5.0)


def test_rotation_grows_by_the_ratio_and_position_by_its_root() -> None:
    grown = replace(USUAL, pull_ratio=16.0).widened(ERRORS, NAIL).image_covariance
    np.testing.assert_allclose(np.diag(grown), [16.0] * 3 + [4.0] * 3 + [16.0] * 3, rtol=1e-4)


def test_processing_turns_the_nail_about_its_holes_whatever_the_noise() -> None:
    known = replace(ERRORS, image_covariance=1e-12 * np.eye(9))
    assert np.allclose(USUAL.widened(known, NAIL).image_covariance, known.image_covariance)
    turned = replace(USUAL, pull_ratio=1e6).widened(known, NAIL).image_covariance[:6, :6]
    turned = turned - np.diag([1e-6] * 3 + [1e-9] * 3)
    tilt_deg = np.degrees(np.sqrt(np.diag(turned)[:3]))
    np.testing.assert_allclose(tilt_deg[:2], AGREEMENT_OF_PARTS.processed_sd_deg, rtol=0.01)
    assert tilt_deg[2] < 0.01
    at_middle = displacement_by_motion(np.mean([hole.axis.point_mm for hole in NAIL.holes], axis=0))
    assert np.abs(at_middle @ turned @ at_middle.T).max() < 1e-6


def test_holes_that_are_turned_against_one_another_leave_the_nails_tilt_as_uncertain() -> None:
    known = replace(ERRORS, image_covariance=np.zeros((9, 9)))
    askew = replace(USUAL, between_holes=np.diag([1e-4, 4e-4])).widened(known, NAIL).image_covariance
    np.testing.assert_allclose(np.diag(askew)[:3], [1e-4, 4e-4, 0.0], atol=1e-12)


def test_a_nail_that_appears_larger_or_smaller_has_holes_at_another_distance_than_filed() -> None:
    apart_mm = NAIL.holes[-1].axis.point_mm[0] - NAIL.holes[0].axis.point_mm[0]
    larger = replace(USUAL, scale_excess=-np.hypot(0.01, AGREEMENT_OF_PARTS.usual_scale_excess))
    assert np.sqrt(2.0) * larger.spread_of_holes_mm(NAIL) == pytest.approx(0.01 * abs(apart_mm))
    assert replace(USUAL, scale_excess=AGREEMENT_OF_PARTS.usual_scale_excess).spread_of_holes_mm(NAIL) == 0.0


def test_radii_are_compared_at_the_nails_own_scale() -> None:
    parameters = np.zeros(PARAMETER_COUNT)
    parameters[Parameter.NAIL_RADIUS_EXCESS_MM] = 0.01 * NAIL.radius_mm
    parameters[Parameter.HOLE_RADIUS_EXCESS_MM] = 0.005 * NAIL.holes[0].diameter_mm
    assert scale_and_shape(NAIL, parameters) == pytest.approx((0.01, 0.0), abs=1e-9)
    parameters[Parameter.HOLE_RADIUS_EXCESS_MM] *= -1.0
    assert scale_and_shape(NAIL, parameters)[1] > 1.0


def test_a_rim_is_seen_in_all_directions_unless_a_part_is_left_out() -> None:
    nail = nail_part()
    assert rim_shares(REGION, nail) == (1.0,) * len(nail.holes)
    hole = nail.holes[0]
    kept = ~((REGION.along_mm < hole.axis.point_mm[0]) & (np.abs(REGION.along_mm - hole.axis.point_mm[0]) < 8.0))
    covered = replace(
        REGION, along_mm=REGION.along_mm[kept], across_mm=REGION.across_mm[kept], compared=REGION.compared[kept]
    )
    first, *others = rim_shares(covered, nail)
    assert 0.45 <= first <= 0.55
    assert all(share == 1.0 for share in others)


def test_a_channel_turns_the_nail_across_its_holes() -> None:
    by_channel = replace(USUAL, channels=np.diag(np.radians([0.3, 0.4]) ** 2))
    assert by_channel.channel_deg == pytest.approx(0.5)
    grown = by_channel.widened(ERRORS, NAIL).covariance - USUAL.widened(ERRORS, NAIL).covariance
    np.testing.assert_allclose(grown[:3, :3], np.diag([*np.radians([0.3, 0.4]) ** 2, 0.0]), atol=1e-12)
