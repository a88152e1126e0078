"""Hole axes in the guide's frame: hand-placed parts, covariance against random errors, which holes are localised."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.drill_clearance import across_basis
from services.registration.core.estimation.image_points import Correspondences, refine_pose
from services.registration.core.estimation.pose_estimate import PoseErrors, PoseEstimate, model_covariance
from services.registration.core.guide.as_built import FocalLength
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.hole_axes import holes_of_guide
from services.registration.core.localise import Parts, hole_estimates
from services.registration.core.tuning import MODEL_ERRORS
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import Line
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.stated_errors import errors_without_shape
from tests.unit.services.registration.xray_scene import calibration, guide_part, nail_part, posed_guide, posed_nail

VIEW = calibration(1024)
KNOWN_SOURCE = replace(VIEW, source_covariance_mm2=np.zeros((3, 3)))
PARTS = Parts(rendered_parts().ring, guide_part(), nail_part(), USUAL_DRILL_DIAMETER_MM)
GUIDE_POSE = posed_guide(20.0, (4.0, -3.0, 630.0))
NAIL_POSE = posed_nail(25.0, (2.0, -3.0), (1.0, 2.0, 740.0))
AS_FILED = FocalLength(0.0, 1e-6, 0.0)  # the guide shows that the ring's plates are apart as in its file


def guide_fit(pose: Transform[Camera, Guide], covariance: NDArray[np.float64]) -> GuideFit:
    part = guide_part()
    px = VIEW.camera.project(pose.points(part.balls.position_mm))
    count = len(part.balls)
    estimate = PoseEstimate.of(pose, covariance)
    return GuideFit(estimate, np.ones(count, bool), px, np.full(count, 0.05), count, 0.05, 10, AS_FILED)


def fit_errors(covariance: NDArray[np.float64]) -> PoseErrors:
    """Errors that come with the image, and no others."""
    return errors_without_shape(covariance, np.zeros((6, 6)))


def test_entry_and_axis_are_those_of_the_composed_poses() -> None:
    holes = hole_estimates(VIEW, PARTS, guide_fit(GUIDE_POSE, np.eye(6)), NailEstimate(NAIL_POSE, None, None))
    assert [hole.id for hole in holes] == ["distal", "proximal"]
    for hole, x_mm in zip(holes, (15.0, -15.0), strict=True):
        entry_camera = NAIL_POSE @ np.array([x_mm, 0.0, -6.0])
        assert GUIDE_POSE @ hole.entry_guide_mm == pytest.approx(entry_camera)
        assert GUIDE_POSE @ hole.exit_guide_mm == pytest.approx(NAIL_POSE @ np.array([x_mm, 0.0, 6.0]))
        assert GUIDE_POSE.directions(hole.axis_guide.direction) == pytest.approx(NAIL_POSE.rotation[:, 2])
        assert hole.offset is None
        assert hole.chance_along_estimate is None


def small_covariance(seed: int) -> NDArray[np.float64]:
    """A correlated covariance of about 0.05 degrees and 0.05 mm."""
    root = np.random.default_rng(seed).standard_normal((6, 6)) * 0.03
    scale = np.diag([np.radians(1.0)] * 3 + [1.0] * 3)
    return np.asarray(scale @ root @ root.T @ scale)


def test_covariance_is_that_of_random_pose_errors() -> None:
    """Draw true poses around the estimated ones: the offsets of the true axis scatter as predicted."""
    rng = np.random.default_rng(1)
    guide_cov, nail_cov = small_covariance(2), small_covariance(3)
    part = nail_part()
    holes = hole_estimates(
        KNOWN_SOURCE,
        PARTS,
        guide_fit(GUIDE_POSE, guide_cov),
        NailEstimate(NAIL_POSE, fit_errors(nail_cov), 10.0),
    )
    guide_steps = rng.multivariate_normal(np.zeros(6), guide_cov, 3000)
    nail_steps = rng.multivariate_normal(np.zeros(6), nail_cov, 3000)
    drawn: list[NDArray[np.float64]] = []
    hole = holes[0]
    across = across_basis(hole.axis_guide.direction)
    ends = np.stack(hole_surface_points(part, part.holes[0]))
    for guide_step, nail_step in zip(guide_steps, nail_steps, strict=True):
        true = GUIDE_POSE.moved(guide_step).inverse().points(NAIL_POSE.moved(nail_step).points(ends))
        drawn.append(((true - np.stack([hole.entry_guide_mm, hole.exit_guide_mm])) @ across.T).ravel())
    assert hole.offset is not None
    sample = np.cov(np.array(drawn).T)
    deviation = np.sqrt(np.diag(hole.offset.covariance_mm2))
    assert np.abs(sample - hole.offset.covariance_mm2) / np.outer(deviation, deviation) == pytest.approx(0.0, abs=0.1)


def test_a_source_a_few_millimetres_off_costs_little_and_is_counted() -> None:
    """One millimetre of the source's distance costs about 0.003 degrees near the image's centre."""
    nail = NailEstimate(NAIL_POSE, fit_errors(np.zeros((6, 6))), 10.0)
    fit = guide_fit(GUIDE_POSE, np.zeros((6, 6)))
    for axis in range(3):
        uncertain = np.zeros((3, 3))
        uncertain[axis, axis] = 1.0
        holes = hole_estimates(replace(VIEW, source_covariance_mm2=uncertain), PARTS, fit, nail)
        assert holes[0].offset is not None
        print(f"axis {axis}: {holes[0].offset.axis_sd_deg:.4f} deg, {holes[0].offset.entry_sd_mm:.4f} mm")
        assert 0.0 < holes[0].offset.axis_sd_deg < 0.02
        assert 0.0 < holes[0].offset.entry_sd_mm < 0.1


def test_pose_refinement_reaches_the_truth_past_outliers() -> None:
    camera = PinholeCamera(VIEW.camera.intrinsic_matrix_px)
    body = np.random.default_rng(4).uniform(-25.0, 25.0, (20, 3))
    turn = Rotation.from_euler("xyz", [10, -8, 50], degrees=True).as_matrix()
    true: Transform[Camera, Guide] = Transform.from_rotation_translation(turn, [3.0, 5.0, 640.0])
    px = camera.project(true.points(body))
    px[:3] += 30.0
    start = true.moved(np.array([0.02, -0.03, 0.05, 1.0, -2.0, 6.0]))
    found = refine_pose(camera, start, Correspondences(body, px, np.full(20, 0.1)))
    assert found.rotation == pytest.approx(true.rotation, abs=1e-5)
    assert found.translation_mm == pytest.approx(true.translation_mm, abs=5e-3)


def test_the_models_error_of_depth_grows_as_the_holes_get_closer() -> None:
    """A shift along the ray: at 740 mm, 740/30 times the error of the distance between holes 30 mm apart."""
    ray = NAIL_POSE.rotation.T @ NAIL_POSE.translation_mm / np.linalg.norm(NAIL_POSE.translation_mm)
    deviations = []
    for hole_x_mm in ((15.0, -15.0), (10.0, -10.0), (0.0,)):
        covariance = model_covariance(nail_part(hole_x_mm=hole_x_mm), NAIL_POSE)
        deviations.append(float(np.sqrt(ray @ covariance[3:, 3:] @ ray)))
    assert deviations == pytest.approx(
        [MODEL_ERRORS.position_mm * 740.0 / known for known in (30.0, 20.0, 12.0)], rel=0.01
    )


def test_an_error_of_depth_moves_the_entry_of_a_tilted_hole() -> None:
    nail = nail_part()
    fit = guide_fit(GUIDE_POSE, np.zeros((6, 6)))
    entry_sd_mm = []
    for tilt_deg in (0.0, 10.0):
        pose = posed_nail(0.0, (tilt_deg, 0.0), (0.0, 0.0, 740.0))
        estimate = NailEstimate(pose, fit_errors(model_covariance(nail, pose)), 50.0)
        offset = hole_estimates(KNOWN_SOURCE, PARTS, fit, estimate)[0].offset
        assert offset is not None
        entry_sd_mm.append(offset.entry_sd_mm)
    depth_sd_mm = MODEL_ERRORS.position_mm * 740.0 / 30.0
    across_mm = depth_sd_mm * np.sin(np.radians(10.0))
    assert entry_sd_mm[1] ** 2 - entry_sd_mm[0] ** 2 == pytest.approx(across_mm**2, rel=0.05)


def test_a_nails_stated_tolerances_are_in_the_covariance_of_its_holes() -> None:
    estimate = NailEstimate(NAIL_POSE, fit_errors(1e-12 * np.eye(6)), 10.0)
    fit = guide_fit(GUIDE_POSE, 1e-12 * np.eye(6))
    plain = hole_estimates(KNOWN_SOURCE, PARTS, fit, estimate)[0].offset
    toleranced = replace(PARTS, nail=replace(PARTS.nail, tolerance_mm=0.1, tolerance_deg=0.5))
    wider = hole_estimates(KNOWN_SOURCE, toleranced, fit, estimate)[0].offset
    assert plain is not None
    assert wider is not None
    assert wider.axis_sd_deg == pytest.approx(0.5, abs=0.02)
    assert wider.entry_sd_mm > plain.entry_sd_mm + 0.1


def test_holes_beside_their_places_count_as_a_tolerance_that_the_file_does_not_state() -> None:
    estimate, fit = NailEstimate(NAIL_POSE, fit_errors(1e-12 * np.eye(6)), 10.0), guide_fit(GUIDE_POSE, np.eye(6))

    def entry_sd_mm(tolerance_mm: float | None, spread_mm: float) -> float:
        parts = replace(PARTS, nail=replace(PARTS.nail, tolerance_mm=tolerance_mm))
        offset = hole_estimates(KNOWN_SOURCE, parts, fit, replace(estimate, hole_spread_mm=spread_mm))[0].offset
        assert offset is not None
        return offset.entry_sd_mm

    assert entry_sd_mm(None, 0.1) == entry_sd_mm(0.02, 0.1) == entry_sd_mm(0.1, 0.0) == entry_sd_mm(0.1, 0.05)
    assert entry_sd_mm(None, 0.0) < entry_sd_mm(None, 0.1)


def turned_hole(name: str, x_mm: float, turn_deg: float) -> Hole:
    turn = np.radians(turn_deg)
    return Hole(name, Line(np.array([x_mm, 0.0, 0.0]), np.array([0.0, np.sin(turn), np.cos(turn)])), 5.0)


def with_further(*further: Hole) -> NailPart:
    nail = nail_part()
    return replace(nail, holes=(*further, *nail.holes))


def ids(holes: tuple[Hole, ...]) -> list[str]:
    return [hole.id for hole in holes]


def test_holes_across_those_of_the_guide_are_not_localised_but_known() -> None:
    nail = holes_of_guide(
        with_further(turned_hole("anterior", 0.0, 90.0), turned_hole("oblique", -27.0, 30.0)), guide_part()
    )
    assert ids(nail.holes) == ["distal", "proximal"]
    assert ids(nail.other_holes) == ["anterior", "oblique"]
    assert {*ids(nail.all_holes)} == {"anterior", "oblique", "distal", "proximal"}
    assert ids(holes_of_guide(nail, guide_part()).other_holes) == ["anterior", "oblique"]


def test_a_guide_for_the_holes_across_has_these_localised() -> None:
    usual = guide_part()
    guide = replace(usual, holes=(replace(usual.holes[0], id="anterior"),))
    nail = holes_of_guide(with_further(turned_hole("anterior", 0.0, 90.0)), guide)
    assert ids(nail.holes) == ["anterior"]
    assert ids(nail.other_holes) == ["distal", "proximal"]


def test_a_hole_somewhat_askew_is_localised_when_the_guide_has_it() -> None:
    usual = guide_part()
    askew = with_further(turned_hole("third", 0.0, 18.0))
    assert ids(holes_of_guide(askew, usual).holes) == ["distal", "proximal"]
    guide = replace(usual, holes=(*usual.holes, replace(usual.holes[0], id="third")))
    assert ids(holes_of_guide(askew, guide).holes) == ["third", "distal", "proximal"]
