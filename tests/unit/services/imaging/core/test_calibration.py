from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.ball_measurement import UprightImage
from services.imaging.core.calibration import calibrate_image, compile_core
from services.imaging.core.motion_blur import _moments
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.similarity_hypotheses import _counted
from services.imaging.core.tuning import RING_MEASUREMENT
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.xray.disc_samples import darkest_spot
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings
from shared.xray.patch_fit import fit_each, fit_patch
from shared.xray.pixel_scale import USUAL_PIXEL_MM, pixels
from tests.unit.services.imaging.synthetic import Rendered, Scene, default_ring, render

PX_PER_MM = 4.37


def accepted(scene: Scene, nominal: NominalGeometry | None = None) -> tuple[CArmCalibration, Rendered]:
    rendered = render(scene, default_ring())
    outcome = calibrate_image(rendered.pixels, default_ring(), nominal or NominalGeometry())
    assert isinstance(outcome, Accepted), outcome
    return outcome.value, rendered


def rejected(pixels: NDArray[np.float32]) -> Rejected:
    outcome = calibrate_image(pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Rejected)
    return outcome


def miss_px(calibration: CArmCalibration, rendered: Rendered) -> NDArray[np.float64]:
    """How far the ray through each ball's true pixel passes from the ball, in pixels of the ring's plane."""
    ball = calibration.camera_from_ring.points(default_ring().balls.position_mm)
    ray = calibration.rays_camera(rendered.centre_px)
    inside = np.hypot(*(rendered.centre_px - 511.5).T) < 460.0
    return np.asarray(np.linalg.norm(np.cross(ball, ray), axis=1)[inside] * PX_PER_MM)


def source_error_mm(calibration: CArmCalibration, rendered: Rendered) -> NDArray[np.float64]:
    pose = calibration.camera_from_ring
    return np.asarray(pose.inverse().translation_mm - rendered.source_mm)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(seed=1),
        Scene(seed=2, mirrored=True, turn_deg=200.0),
        Scene(seed=3, top=255.0, turn_deg=-80.0),
        Scene(seed=4, present=0.6, turn_deg=110.0, pincushion=0.07),
    ],
    ids=["plain", "mirrored", "8 bits", "60 per cent"],
)
def test_source_and_rays_are_right(scene: Scene) -> None:
    calibration, rendered = accepted(scene)
    assert calibration.mirrored is scene.mirrored
    error = source_error_mm(calibration, rendered)
    assert np.abs(error[:2]).max() < 0.15
    assert abs(error[2]) < 1.0
    assert np.sqrt(np.mean(miss_px(calibration, rendered) ** 2)) < 0.1
    assert calibration.balls_found >= 0.9 * np.count_nonzero(rendered.present)
    assert calibration.balls_expected == 120
    assert calibration.runner_up_margin > 30
    assert calibration.aperture is not None


def test_identified_balls_carry_the_right_index_and_others_none() -> None:
    calibration, rendered = accepted(Scene(seed=5, mirrored=True))
    balls = calibration.balls
    known = balls.ring_index >= 0
    error = np.hypot(*(balls.centre_px[known] - rendered.centre_px[balls.ring_index[known]]).T)
    assert error.max() < 0.6
    distance = np.hypot(*(rendered.others_px[:, None] - balls.centre_px[~known][None]).transpose(2, 0, 1)).min(axis=1)
    assert np.median(distance) < 0.15
    assert np.mean(distance < 1.0) > 0.7  # the others overlap at random
    assert len(np.unique(balls.ring_index[known])) == np.count_nonzero(known)


def test_projecting_a_ball_gives_the_pixel_where_it_was_measured() -> None:
    calibration, rendered = accepted(Scene(seed=6))
    ball = calibration.camera_from_ring.points(default_ring().balls.position_mm)
    inside = np.hypot(*(rendered.centre_px - 511.5).T) < 460.0
    error = calibration.image_from_camera(ball)[inside] - rendered.centre_px[inside]
    assert np.sqrt(np.mean(error**2)) < 0.08


def test_a_flat_panel_has_next_to_no_distortion() -> None:
    calibration, rendered = accepted(Scene(seed=7, pincushion=0.0, bend_px=0.0, aperture=False))
    assert calibration.aperture is None
    assert np.abs(calibration.distortion.displacement_at(rendered.centre_px)).max() < 0.25
    assert np.abs(source_error_mm(calibration, rendered)).max() < 1.0


def test_nominal_values_that_are_ten_per_cent_wrong_change_nothing() -> None:
    scene = Scene(seed=8, turn_deg=250.0)
    right, rendered = accepted(scene)
    wrong, _ = accepted(scene, NominalGeometry(1090.0, 0.214))
    assert wrong.camera_from_ring.inverse().translation_mm == pytest.approx(
        right.camera_from_ring.inverse().translation_mm, abs=0.3
    )
    assert np.sqrt(np.mean(miss_px(wrong, rendered) ** 2)) < 0.1


@pytest.mark.requirement("IMG-01")
def test_an_image_without_ring_is_refused_with_figures() -> None:
    outcome = rejected(render(Scene(seed=9, present=0.0, others=30), default_ring()).pixels)
    assert outcome.reasons[0].code is ReasonCode.RING_NOT_FOUND
    assert "dark discs" in outcome.reasons[0].message


@pytest.mark.requirement("IMG-01")
def test_an_inverted_image_without_tag_is_refused_as_inverted() -> None:
    pixels = render(Scene(seed=10), default_ring()).pixels
    outcome = rejected(np.asarray(pixels.max() - pixels, np.float32))
    assert outcome.reasons[0].code is ReasonCode.IMAGE_UNUSABLE
    assert "inverted" in outcome.reasons[0].message


def test_too_few_balls_are_refused_as_such() -> None:
    outcome = rejected(render(Scene(seed=11, present=0.3), default_ring()).pixels)
    assert outcome.reasons[0].code is ReasonCode.RING_TOO_FEW_BALLS
    assert "at least 48" in outcome.reasons[0].message


@pytest.mark.requirement("IMG-01")
def test_a_moved_image_is_refused_as_blurred() -> None:
    pixels = render(Scene(seed=12), default_ring()).pixels
    moved = cv2.blur(pixels, (9, 1)).astype(np.float32)
    outcome = rejected(moved)
    assert ReasonCode.MOTION_BLUR in [r.code for r in outcome.reasons]


def test_an_empty_image_is_refused() -> None:
    outcome = rejected(np.full((512, 512), 77.0, np.float32))
    assert outcome.reasons[0].code is ReasonCode.IMAGE_UNUSABLE
    assert "1 different grey values" in outcome.reasons[0].message


def test_a_thumbnail_is_refused() -> None:
    pixels = render(Scene(seed=13), default_ring()).pixels[::8, ::8]
    outcome = rejected(np.ascontiguousarray(pixels))
    assert outcome.reasons[0].code is ReasonCode.IMAGE_UNUSABLE
    assert "128 x 128 pixels" in outcome.reasons[0].message


@pytest.mark.requirement("IMG-01")
def test_an_overexposed_image_is_refused_as_saturated() -> None:
    scene = Scene(seed=14, aperture=False)
    pixels = render(scene, default_ring()).pixels
    limit = np.float32(0.25 * pixels.max())
    outcome = rejected(np.minimum(pixels, limit) + np.arange(1024, dtype=np.float32) * np.float32(0.0))
    assert ReasonCode.SATURATED in [r.code for r in outcome.reasons]


def test_a_ring_that_lost_its_middle_is_refused_only_when_it_matters() -> None:
    ring = default_ring()
    radius = np.hypot(*ring.balls.position_mm[:, :2].T)
    calibration, _ = accepted(replace(Scene(seed=15), missing=tuple(np.flatnonzero(radius < 30.0).tolist())))
    assert calibration.balls_found > 80


@pytest.mark.parametrize("grey", [0.0, 65535.0], ids=["dark", "bright"])
def test_burnt_in_text_and_the_apertures_border_are_no_balls(grey: float) -> None:
    rendered = render(Scene(seed=16), default_ring())
    pixels = rendered.pixels.copy()
    for row in (80, 512, 930):
        cv2.putText(pixels, "o0O.:8 70 kV .", (330, row), cv2.FONT_HERSHEY_SIMPLEX, 0.6, grey, 2, cv2.LINE_AA)
    outcome = calibrate_image(pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Accepted)
    balls = outcome.value.balls
    named = balls.ring_index >= 0
    error = np.hypot(*(balls.centre_px[named] - rendered.centre_px[balls.ring_index[named]]).T)
    assert error.max() < 1.5
    assert np.hypot(*(balls.centre_px[named] - 511.5).T).max() < 484.0
    assert np.count_nonzero(named) > 90
    assert np.abs(source_error_mm(outcome.value, rendered)).max() < 1.0


@pytest.mark.parametrize("line", [np.s_[424], np.s_[:, 600]], ids=["row", "column"])
def test_a_black_line_across_the_aperture_does_not_part_it(line: tuple[slice | int, ...]) -> None:
    rendered = render(Scene(seed=18), default_ring())
    pixels = rendered.pixels.copy()
    pixels[line] = 0.0
    outcome = calibrate_image(pixels, default_ring(), NominalGeometry())
    assert isinstance(outcome, Accepted)
    assert outcome.value.aperture is not None
    assert outcome.value.balls_found >= 0.85 * np.count_nonzero(rendered.present)
    assert np.abs(source_error_mm(outcome.value, rendered)).max() < 1.0


def test_the_search_for_balls_widens_where_the_discs_predict_them_badly(monkeypatch: pytest.MonkeyPatch) -> None:
    drifts: list[NDArray[np.float64]] = []
    measure = UprightImage.measure

    def recorded(image: UprightImage, expected: Discs, settings: MeasurementSettings) -> BallMeasurements:
        drifts.append(np.asarray(settings.drift_px))
        return measure(image, expected, settings)

    monkeypatch.setattr(UprightImage, "measure", recorded)
    for noise in (0.005, 0.14):
        accepted(Scene(seed=204, present=0.6, noise=noise))
    clear_px, faint_px = drifts
    usual_px = pixels(RING_MEASUREMENT.drift_detector_mm, USUAL_PIXEL_MM)
    assert np.median(clear_px) < 1.2 * usual_px
    assert np.median(faint_px) > 1.5 * usual_px


def test_every_compiled_function_that_images_go_through_is_compiled() -> None:
    compile_core()
    for function in (_moments, _counted, darkest_spot, fit_each, fit_patch):
        assert getattr(function, "signatures", ()), function
