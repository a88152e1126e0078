"""Several images of one set-up: the joint pose against drawn errors, and contradictions told for what they are."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from services.registration.core.alignment import c_arm_correction_deg
from services.registration.core.fusion.agreement import disagreement, leave_one_out
from services.registration.core.fusion.fuse import fuse
from services.registration.core.fusion.joint_errors import joint_covariance
from services.registration.core.fusion.localise import LocalisedImage, fuse_localisations
from services.registration.core.hole_axes import hole_estimates
from services.registration.core.localise import LocalisationResult, Method, Parts
from services.registration.core.nail_estimate import NailEstimate
from services.registration.core.pose_errors import PoseErrors, model_loadings
from services.registration.core.pose_evidence import PoseEvidence, motion_between, motion_of_nail, moved_by
from shared.errors import Reason, ReasonCode
from shared.geometry.frames import Guide, Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.stated_errors import errors_without_shape
from tests.unit.services.registration.test_hole_axes import GUIDE_POSE, KNOWN_SOURCE, NAIL_POSE, guide_fit
from tests.unit.services.registration.xray_scene import guide_part, nail_part

POSE: Transform[Guide, Nail] = Transform.from_rotvec(np.radians([1.0, -2.0, 1.5]), [1.0, -2.0, 115.0])
SIGMAS = np.concatenate([np.radians([0.12, 0.10, 0.02]), [0.03, 0.03]])
DEPTH_SD_MM = 0.5
FROM_ABOVE = (0.0, 0.0)


def evidence(lean_deg: tuple[float, float] = FROM_ABOVE, pose: Transform[Guide, Nail] = POSE) -> PoseEvidence:
    """An image whose beam leans against the nail's z axis: good across its ray, weak along it."""
    ray = Rotation.from_rotvec(np.radians([*lean_deg, 0.0])).apply([0.0, 0.0, 1.0])
    covariance = np.diag(np.concatenate([SIGMAS, [0.03]]) ** 2)
    covariance[3:, 3:] += DEPTH_SD_MM**2 * np.outer(ray, ray)
    by_model = np.diag(np.radians([0.04, 0.04, 0.02, 0.0, 0.0, 0.0]))
    return PoseEvidence(pose, ray, errors_without_shape(covariance, by_model))


def shifted(one: PoseEvidence, motion: NDArray[np.float64]) -> PoseEvidence:
    return replace(one, guide_from_nail=moved_by(one.guide_from_nail, motion))


def with_errors(one: PoseEvidence, **changed: NDArray[np.float64]) -> PoseEvidence:
    return replace(one, errors=replace(one.errors, **changed))


def across_mm(x: float, y: float) -> NDArray[np.float64]:
    return np.array([0.0, 0.0, 0.0, x, y, 0.0])


def test_motions_of_the_guide_are_motions_of_the_nail() -> None:
    motion = np.array([1e-5, -2e-5, 3e-5, 0.001, 0.002, -0.003])
    step: Transform[Guide, Guide] = Transform.from_rotvec(motion[:3], motion[3:])
    assert motion_between(POSE, step @ POSE) == pytest.approx(motion_of_nail(POSE) @ motion, abs=1e-7)
    assert motion_between(POSE, moved_by(POSE, motion)) == pytest.approx(motion, abs=1e-12)


def test_one_image_says_what_it_said() -> None:
    one = evidence()
    joint = fuse((one,))
    assert joint.guide_from_nail.matrix == pytest.approx(POSE.matrix)
    assert joint.covariance == pytest.approx(one.covariance)
    assert joint.chi_square == pytest.approx(0.0)
    assert joint.degrees_of_freedom == 0


def test_two_directions_show_the_depth() -> None:
    lateral, oblique = evidence(), evidence((38.0, 0.0))
    alone, joint = fuse((lateral,)), fuse((lateral, oblique))
    assert np.sqrt(alone.covariance[5, 5]) == pytest.approx(DEPTH_SD_MM, rel=0.01)
    # across the oblique ray the nail is known to 0.03 mm: seen from there, that is depth over the angle's sine
    assert np.sqrt(joint.covariance[5, 5]) < 2.0 * 0.03 / np.sin(np.radians(38.0))
    moved = shifted(lateral, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.8]))
    found = fuse((moved, oblique)).guide_from_nail
    assert abs(motion_between(POSE, found)[5]) < 0.05


def test_images_from_one_direction_share_most_of_their_errors() -> None:
    same, apart = fuse((evidence(), evidence())), fuse((evidence(), evidence((0.0, 9.0))))
    alone = evidence().covariance
    assert np.sqrt(same.covariance[0, 0] / alone[0, 0]) == pytest.approx(np.sqrt((1.0 + 0.7) / 2.0), abs=0.01)
    assert np.sqrt(apart.covariance[0, 0] / alone[0, 0]) < 0.8


def test_the_models_own_errors_hardly_average_out() -> None:
    only_model = tuple(
        with_errors(evidence((0.0, lean)), image_covariance=np.eye(6) * 1e-10) for lean in (0.0, 5.0, 10.0, 15.0)
    )
    ratio = fuse(only_model).covariance[0, 0] / only_model[0].covariance[0, 0]
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


def of_unknown_radius(lean_deg: float, leant_deg: float, radius_sd: float) -> PoseEvidence:
    """An image of a nail whose holes' radius is not known, as a fit to a linear model would tell of it."""
    information = information_of(lean_deg, leant_deg, radius_sd)
    spread = np.asarray(np.linalg.inv(information + np.diag(RADIUS)), dtype=np.float64)
    one = evidence((lean_deg, 0.0))
    by_model = np.vstack([one.errors.model_loadings, np.zeros(6)])
    errors = PoseErrors(np.zeros(1), np.asarray(spread @ information @ spread), spread[:, 6:], by_model)
    return replace(one, errors=errors)


def fitted(one: PoseEvidence, radius: float, error: NDArray[np.float64] = NO_ERROR) -> PoseEvidence:
    """What the image says of a nail with such a radius when the fit errs by so much, shape (7,)."""
    error = error + radius * one.errors.shape_pull[:, 0]
    told = replace(one, errors=replace(one.errors, shape_deviations=np.array([radius - error[6]])))
    return shifted(told, -error[:6])


def lean_deg(pose: Transform[Guide, Nail]) -> float:
    return float(np.degrees(motion_between(POSE, pose)[0]))


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
    found = motion_between(POSE, joint.guide_from_nail)
    assert found / deviation == pytest.approx(np.linalg.solve(total, side)[:6] / deviation, abs=1e-4)
    assert np.sqrt(np.diag(joint.covariance)) == pytest.approx(deviation, rel=0.01)


def test_a_radius_seen_from_both_sides_is_told_from_a_tilt() -> None:
    """Leaning the beam the other way turns the radius's part round: what both images share is the radius."""
    there, back = of_unknown_radius(5.0, 0.2, 3.0), of_unknown_radius(-5.0, -0.1, 3.0)
    images = (fitted(there, 2.0), fitted(back, 2.0))
    joint = fuse(images)
    alone = [lean_deg(one.guide_from_nail) for one in images]
    print(f"alone {alone[0]:.3f} and {alone[1]:.3f} degrees, together {lean_deg(joint.guide_from_nail):.3f}")
    assert min(abs(off) for off in alone) > 0.1
    assert abs(lean_deg(joint.guide_from_nail)) < 0.4 * min(abs(off) for off in alone)
    known = fuse((evidence((5.0, 0.0)), evidence((-5.0, 0.0)))).covariance[0, 0]
    unknown = min(one.covariance[0, 0] for one in images)
    assert known < joint.covariance[0, 0] < 0.75 * unknown
    # half a degree apart, by a radius of two standard deviations: no contradiction
    assert joint.chi_square < 5.0


def test_a_radius_seen_twice_from_one_side_stays_unknown() -> None:
    images = (of_unknown_radius(5.0, 0.2, 3.0), of_unknown_radius(5.5, 0.2, 3.0))
    joint = fuse(tuple(fitted(one, 2.0) for one in images))
    assert lean_deg(joint.guide_from_nail) == pytest.approx(lean_deg(fitted(images[0], 2.0).guide_from_nail), rel=0.1)
    assert joint.covariance[0, 0] > 0.85 * images[0].covariance[0, 0]


def test_images_that_find_different_nails_contradict_one_another() -> None:
    """The guide in the same place, and wider holes: they would move the joint pose where neither image has it."""
    sharp = (of_unknown_radius(5.0, 0.2, 0.3), of_unknown_radius(-5.0, -0.2, 0.3))
    images = tuple(with_errors(one, shape_deviations=np.array([d])) for one, d in zip(sharp, (3.0, -3.0), strict=True))
    assert abs(lean_deg(fuse(images).guide_from_nail)) > 0.3
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
    assert other.guide_from_nail.matrix == pytest.approx(joint.guide_from_nail.matrix, abs=1e-6)
    assert other.chi_square == pytest.approx(joint.chi_square)
    assert joint.degrees_of_freedom == 6
    assert np.all(np.linalg.eigvalsh(joint.covariance) > 0.0)


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
    root = np.linalg.cholesky(joint_covariance(images))
    normalised = []
    for _ in range(300):
        errors, radius = (root @ rng.standard_normal(21)).reshape(3, 7), float(rng.standard_normal())
        joint = fuse(tuple(fitted(image, radius, error) for image, error in zip(images, errors, strict=True)))
        normalised.append(motion_between(POSE, joint.guide_from_nail) / np.sqrt(np.diag(joint.covariance)))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    print(f"seed {seed}, normalised rms {np.round(rms, 2)}")
    assert np.all((rms > 0.88) & (rms < 1.12))


def told(images: tuple[PoseEvidence, ...]) -> Reason | None:
    names = tuple(f"{k + 1}" for k in range(len(images)))
    return disagreement(images, names, nail_part(), NAIL_POSE)


def message(images: tuple[PoseEvidence, ...]) -> str:
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


def test_a_loose_guide_lets_no_images_agree() -> None:
    places = (across_mm(0.0, 0.0), across_mm(1.5, 0.0), across_mm(0.0, 1.5), across_mm(-1.5, 0.5))
    words = message(tuple(shifted(image, place) for image, place in zip(AGREEING, places, strict=True)))
    assert "no images of the 4 agree" in words


def test_the_odd_one_raises_chi_square_most() -> None:
    influence = leave_one_out((AGREEING[0], shifted(AGREEING[1], MOVED), AGREEING[2]))
    assert int(np.argmax(influence)) == 1


PARTS = Parts(rendered_parts().ring, guide_part(), nail_part())


def localised(name: str, moved_mm: float = 0.0, spread: float = 1.0, *reasons: Reason) -> LocalisedImage:
    """An image by a known camera; the nail moved across the beam, and its fit's standard deviations spread."""
    fit_covariance = block_diag(np.eye(3) * np.radians(0.05) ** 2, np.diag([0.02, 0.02, 0.2]) ** 2) * spread**2
    step: Transform[Nail, Nail] = Transform.from_rotvec(np.zeros(3), [moved_mm, 0.0, 0.0])
    pose = NAIL_POSE @ step
    guide = guide_fit(GUIDE_POSE, np.eye(6) * 1e-8)
    errors = errors_without_shape(fit_covariance, model_loadings(PARTS.nail, pose))
    nail = NailEstimate(pose, errors, 100.0, None)
    holes = hole_estimates(KNOWN_SOURCE, PARTS.guide, PARTS.nail, guide, nail)
    correction = c_arm_correction_deg(pose, PARTS.nail)
    guide_from_nail = GUIDE_POSE.inverse() @ pose
    result = LocalisationResult(Method.MODEL, reasons, guide, nail, guide_from_nail, holes, correction)
    return LocalisedImage(name, KNOWN_SOURCE, result, reasons)


UNCERTAIN = Reason(ReasonCode.UNCERTAINTY_TOO_LARGE, "too uncertain; more dose")
AMBIGUOUS = Reason(ReasonCode.MIRROR_AMBIGUOUS, "two tilts; turn the C-arm")
NOTHING = LocalisedImage("empty", None, None, (Reason(ReasonCode.RING_NOT_FOUND, "no ring; show it"),))


def test_good_images_are_joined_and_the_newest_is_shown() -> None:
    fused = fuse_localisations((localised("a"), localised("b", 0.02)), PARTS)
    assert fused is not None
    assert fused.result.accepted
    assert fused.shown == 1
    assert [share.used for share in fused.shares] == [True, True]
    assert fused.result.guide_from_nail is not None
    between = motion_between(GUIDE_POSE.inverse() @ NAIL_POSE, fused.result.guide_from_nail)
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


def test_contradicting_images_keep_the_newest_but_refuse_it() -> None:
    fused = fuse_localisations((localised("a"), localised("b", 2.0)), PARTS)
    assert fused is not None
    assert [reason.code for reason in fused.result.reasons] == [ReasonCode.IMAGES_DISAGREE]
    assert "images a and b" in fused.result.reasons[0].message


def test_no_usable_image_leaves_nothing_to_join() -> None:
    assert fuse_localisations((NOTHING, localised("b", 0.0, 1.0, AMBIGUOUS)), PARTS) is None
