"""How errors of several images hang together, and what that makes of the pose and the nail's shape they share."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.estimation.joint import fuse, joint_covariance
from services.registration.core.estimation.pose_estimate import PoseErrors
from shared.geometry.frames import Guide, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.core.estimation.stated_estimates import (
    POSE,
    Estimate,
    evidence,
    shifted,
    told,
    with_errors,
)


def test_images_from_one_direction_share_most_of_their_errors() -> None:
    same, apart = fuse((evidence(), evidence())), fuse((evidence(), evidence((0.0, 9.0))))
    alone = evidence().covariance
    assert np.sqrt(same.pose.covariance[0, 0] / alone[0, 0]) == pytest.approx(np.sqrt((1.0 + 0.7) / 2.0), abs=0.01)
    assert np.sqrt(apart.pose.covariance[0, 0] / alone[0, 0]) < 0.8


def test_the_models_own_errors_hardly_average_out() -> None:
    only_model = tuple(
        with_errors(evidence((0.0, lean)), image_covariance=np.eye(6) * 1e-10) for lean in (0.0, 5.0, 10.0, 15.0)
    )
    ratio = fuse(only_model).pose.covariance[0, 0] / only_model[0].covariance[0, 0]
    assert ratio == pytest.approx(0.5 + 0.5 / 4.0, abs=0.01)


NO_ERROR, RADIUS = np.zeros(7), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def information_of(lean_deg: float, leant_deg: float, radius_sd: float) -> NDArray[np.float64]:
    """What the pixels of an image tell of pose and holes' radius, shape (7, 7).

    Parameters
    ----------
    leant_deg
        How much a tilt about x, by the look of it, one standard deviation of the radius makes.
    radius_sd
        How uncertain the image would leave the radius if the pose were known, in such deviations.
    """
    looks_like = np.eye(7)
    looks_like[0, 6] = np.radians(leant_deg)
    pose = np.linalg.inv(evidence((lean_deg, 0.0)).errors.image_covariance)
    return np.asarray(looks_like.T @ block_diag(pose, np.array([[radius_sd**-2]])) @ looks_like)


def of_unknown_radius(lean_deg: float, leant_deg: float, radius_sd: float) -> Estimate:
    """An image of a nail whose holes' radius is not known, as a fit to a linear model would tell of it."""
    information = information_of(lean_deg, leant_deg, radius_sd)
    spread = np.asarray(np.linalg.inv(information + np.diag(RADIUS)), dtype=np.float64)
    one = evidence((lean_deg, 0.0))
    by_model = np.vstack([one.errors.model_loadings, np.zeros(6)])
    errors = PoseErrors(np.zeros(1), np.asarray(spread @ information @ spread), spread[:, 6:], by_model, one.errors.ray)
    return replace(one, errors=errors)


def fitted(one: Estimate, radius: float, error: NDArray[np.float64] = NO_ERROR) -> Estimate:
    """What the image says of a nail with such a radius when the fit errs by so much, shape (7,)."""
    error = error + radius * one.errors.shape_pull[:, 0]
    told = replace(one, errors=replace(one.errors, shape_deviations=np.array([radius - error[6]])))
    return shifted(told, -error[:6])


def lean_deg(pose: Transform[Guide, Nail]) -> float:
    return float(np.degrees(POSE.motion_to(pose)[0]))


def test_joint_estimate_is_that_of_all_pixels_at_once() -> None:
    """Where models are linear and only the nail is shared: least squares over both images, and the file told once."""
    models = ((10.0, 0.2, 0.4), (-10.0, -0.1, 0.8))
    informations = [information_of(*one) for one in models]
    images, total, side = [], np.diag(RADIUS), np.zeros(7)
    # so small that turns and shifts add up
    errors, radius = 0.01 * np.random.default_rng(8).standard_normal((2, 7)), 0.015
    for model, information, drawn in zip(models, informations, errors, strict=True):
        seen = radius * RADIUS + np.linalg.cholesky(np.linalg.inv(information)) @ drawn
        alone = np.linalg.solve(information + np.diag(RADIUS), information @ seen)
        one = with_errors(of_unknown_radius(*model), shape_deviations=alone[6:], model_loadings=np.zeros((7, 0)))
        images.append(shifted(one, alone[:6]))
        total, side = total + information, side + information @ seen
    joint = fuse(tuple(images))
    deviation = np.sqrt(np.diag(np.linalg.inv(total)))[:6]
    found = POSE.motion_to(joint.pose.mean)
    assert found / deviation == pytest.approx(np.linalg.solve(total, side)[:6] / deviation, abs=1e-4)
    assert np.sqrt(np.diag(joint.pose.covariance)) == pytest.approx(deviation, rel=0.01)


def test_a_radius_seen_from_both_sides_is_told_from_a_tilt() -> None:
    """Leaning the beam the other way turns the radius's part round: what both images share is the radius."""
    there, back = of_unknown_radius(5.0, 0.2, 3.0), of_unknown_radius(-5.0, -0.1, 3.0)
    images = (fitted(there, 2.0), fitted(back, 2.0))
    joint = fuse(images)
    alone = [lean_deg(one.mean) for one in images]
    print(f"alone {alone[0]:.3f} and {alone[1]:.3f} degrees, together {lean_deg(joint.pose.mean):.3f}")
    assert min(abs(off) for off in alone) > 0.1
    assert abs(lean_deg(joint.pose.mean)) < 0.4 * min(abs(off) for off in alone)
    known = fuse((evidence((5.0, 0.0)), evidence((-5.0, 0.0)))).pose.covariance[0, 0]
    unknown = min(one.covariance[0, 0] for one in images)
    assert known < joint.pose.covariance[0, 0] < 0.75 * unknown
    # half a degree apart, by a radius of two standard deviations: no contradiction
    assert joint.chi_square < 5.0


def test_a_radius_seen_twice_from_one_side_stays_unknown() -> None:
    images = (of_unknown_radius(5.0, 0.2, 3.0), of_unknown_radius(5.5, 0.2, 3.0))
    joint = fuse(tuple(fitted(one, 2.0) for one in images))
    assert lean_deg(joint.pose.mean) == pytest.approx(lean_deg(fitted(images[0], 2.0).mean), rel=0.1)
    assert joint.pose.covariance[0, 0] > 0.85 * images[0].covariance[0, 0]


def test_images_that_find_different_nails_contradict_one_another() -> None:
    """The guide in the same place, and wider holes: they would move the joint pose where neither image has it."""
    sharp = (of_unknown_radius(5.0, 0.2, 0.3), of_unknown_radius(-5.0, -0.2, 0.3))
    images = tuple(with_errors(one, shape_deviations=np.array([d])) for one, d in zip(sharp, (3.0, -3.0), strict=True))
    assert abs(lean_deg(fuse(images).pose.mean)) > 0.3
    reason = told(images)
    assert reason is not None
    assert "the holes' radius by 0.18 mm" in reason.message
    alike = tuple(with_errors(one, shape_deviations=np.array([0.4])) for one in sharp)
    assert told(alike) is None


def test_an_image_that_tells_nothing_of_the_shape_has_no_say_in_it() -> None:
    """As where no chamfer is left to shrink: no derivative, and neither response nor noise."""
    there, silent = of_unknown_radius(5.0, 0.2, 3.0), of_unknown_radius(-5.0, 0.0, np.inf)
    joint, other = (
        fuse((fitted(there, 2.0), with_errors(silent, shape_deviations=told))) for told in (RADIUS[:1], RADIUS[6:])
    )
    assert other.pose.mean.matrix == pytest.approx(joint.pose.mean.matrix, abs=1e-6)
    assert other.chi_square == pytest.approx(joint.chi_square)
    assert joint.degrees_of_freedom == 6
    assert np.all(np.linalg.eigvalsh(joint.pose.covariance) > 0.0)


def test_two_images_from_one_side_count_little_more_than_one() -> None:
    """Images A, A' and one from far away: by the errors that A and A' share, B has more than a third of the say."""
    joint = fuse((evidence(), evidence(), evidence((30.0, 0.0))))
    say = [float(weight[0, 0]) for weight in joint.weights]
    assert say[0] == pytest.approx(say[1])
    assert sum(say) == pytest.approx(1.0)
    assert say[2] / say[0] == pytest.approx(1.7, rel=0.05)


def test_errors_are_as_large_as_predicted_when_images_share_as_assumed() -> None:
    seed = 20261
    rng = np.random.default_rng(seed)
    images = (
        of_unknown_radius(2.0, 0.08, 2.0),
        of_unknown_radius(2.5, 0.08, 2.0),
        of_unknown_radius(-5.0, -0.2, 0.5),
    )
    root = np.linalg.cholesky(joint_covariance(tuple(image.errors for image in images)))
    normalised = []
    for _ in range(300):
        errors, radius = (root @ rng.standard_normal(21)).reshape(3, 7), float(rng.standard_normal())
        joint = fuse(tuple(fitted(image, radius, error) for image, error in zip(images, errors, strict=True)))
        normalised.append(POSE.motion_to(joint.pose.mean) / np.sqrt(np.diag(joint.pose.covariance)))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    print(f"seed {seed}, normalised rms {np.round(rms, 2)}")
    assert np.all((rms > 0.88) & (rms < 1.12))


def held(lean_deg: tuple[float, float], z_per_m: float = 0.0) -> Estimate:
    """An image in which a nail passed as straight; its curvature would turn the fit by 0.5° per 1/m."""
    one, by_curvature = evidence(lean_deg), np.zeros((6, 2))
    by_curvature[1, 1] = np.radians(0.5)
    errors = one.errors.with_held_curvature(0.07, by_curvature)
    return replace(one, mean=one.mean.moved(by_curvature @ [0.0, z_per_m]), errors=errors)


def bent(z_per_m: float) -> Estimate:
    """An image in which the curvature was free, in deviations of 2/m, and found within 0.1/m."""
    one = evidence()
    free = one.errors.with_held_curvature(2.0, np.zeros((6, 2)))
    covariance = free.image_covariance + np.diag([0.0] * 6 + [0.05**2] * 2)
    deviations, none = np.array([0.0, z_per_m / 2.0]), np.zeros_like(free.shape_pull)
    errors = replace(free, shape_deviations=deviations, image_covariance=covariance, shape_pull=none)
    return replace(one, errors=errors)


def test_nails_that_no_image_shows_bent_stay_straight_within_their_tolerance() -> None:
    joint = fuse((held((0.0, 0.0)), held((0.0, 20.0))))
    assert joint.curvature_per_m == (0.0, 0.0)
    assert joint.covariance_with_bend is not None
    assert np.sqrt(np.diag(joint.covariance_with_bend)[6:]) == pytest.approx(0.07)


@pytest.mark.parametrize("others", [0, 1, 2])
def test_a_nail_that_one_image_shows_bent_is_bent(others: int) -> None:
    joint = fuse((*(held((0.0, 20.0), 1.5),) * others, bent(1.5)))
    assert joint.curvature_per_m == pytest.approx((0.0, 1.5), abs=0.01)
    assert joint.covariance_with_bend is not None
    assert 0.05 < np.sqrt(joint.covariance_with_bend[7, 7]) < 0.101


def test_a_change_of_the_deviation_changes_no_error() -> None:
    errors = held((0.0, 5.0)).errors
    other = errors.with_bend_in(0.14)
    assert other.shape_pull[1, 1] == pytest.approx(2.0 * errors.shape_pull[1, 1])
    assert other.own_covariance == pytest.approx(errors.own_covariance)
    assert bent(1.5).errors.with_bend_in(1.0).curvature_per_m == pytest.approx([0.0, 1.5])
