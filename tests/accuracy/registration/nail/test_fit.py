"""The nail's fit on images of a small fluoroscope: accuracy, capture, honest covariance, refusals."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.fit import fit_nail
from services.registration.core.nail.image_fit import NailFit
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import angle_between_rad
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from tests.accuracy.registration.nail.fluoroscope import Shot, nail_part, posed, shoot

pytestmark = pytest.mark.slow

STEEL = nail_part("steel", 12.0, 6.0)
TITANIUM = nail_part("Ti6Al4V", 11.0, 5.3, 4.5)
SHOTS = 4


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fit beside its truth; `normalised` is the error of the pose over its standard deviation, shape (6,)."""

    axis_deg: float
    across_mm: float
    normalised: NDArray[np.float64]
    fit: NailFit


def start_beside(truth: Transform[Camera, Nail], rng: np.random.Generator) -> Transform[Camera, Nail]:
    """A start that is some degrees and a millimetre off."""
    offset = rng.normal(size=3) * [1.0, 1.0, 3.0]
    return truth @ Transform[Nail, Nail].from_rotvec(np.radians(3.0 * rng.normal(size=3)), offset)


def accepted(shot: Shot, start: Transform[Camera, Nail]) -> Outcome:
    result = fit_nail(FitInput(shot.pixels, shot.calibration, shot.nail, shot.occluders), start)
    assert isinstance(result, Accepted), result
    fit = result.value
    motion = fit.camera_from_nail.inverse() @ shot.camera_from_nail
    error = np.concatenate([motion.rotation_vector_rad, motion.translation_mm])
    axes = [pose.rotation[:, 2] for pose in (fit.camera_from_nail, shot.camera_from_nail)]
    apart = fit.camera_from_nail.translation_mm - shot.camera_from_nail.translation_mm
    across = float(np.linalg.norm(apart - axes[1] * (apart @ axes[1])))
    # images are drawn by the fit's own model, which has no errors here
    errors = replace(fit.errors, model_loadings=np.zeros((len(fit.errors.own_covariance), 0)))
    normalised = error / np.sqrt(np.diag(errors.covariance))
    return Outcome(float(np.degrees(angle_between_rad(axes[0], axes[1]))), across, normalised, fit)


@cache
def outcomes() -> tuple[Outcome, ...]:
    """Fits of several nails, tilts, textures and guides, from starts that are off."""
    results = []
    for seed in range(SHOTS):
        rng = np.random.default_rng([20, seed])
        nail = STEEL if seed % 2 else TITANIUM
        pitch_deg, roll_deg = rng.uniform(-7.0, 7.0, 2)
        truth = posed(pitch_deg, roll_deg, rng.uniform(0.0, 360.0))
        beside = (float(rng.uniform(-3.0, 3.0)), float(rng.uniform(-3.0, 3.0)))
        shot = shoot(nail, truth, beside, seed)
        results.append(accepted(shot, start_beside(truth, rng)))
        print(f"seed {seed}: {results[-1].axis_deg:.3f} deg, {results[-1].across_mm:.3f} mm")
    return tuple(results)


def test_axes_and_places_are_accurate() -> None:
    degrees = np.array([o.axis_deg for o in outcomes()])
    # measured: median 0.036 and largest 0.055 degrees, largest 0.010 mm
    assert np.median(degrees) < 0.05
    assert degrees.max() < 0.081
    assert max(o.across_mm for o in outcomes()) < 0.015


@pytest.mark.requirement("REG-06")
def test_predicted_errors_are_those_that_occur() -> None:
    normalised = np.array([o.normalised for o in outcomes()])
    # measured: rms 1.19
    assert 0.79 < float(np.sqrt(np.mean(normalised**2))) < 1.78


@pytest.mark.requirement("REG-02")
def test_the_reflected_tilt_is_worse_by_a_margin() -> None:
    assert min(o.fit.evidence.mirror_margin for o in outcomes()) > 53.0  # measured: 80.5


@pytest.mark.long
def test_the_hardening_of_the_beam_does_not_turn_a_titanium_nail() -> None:
    """Where a rim's metal is thin, the law of what passes is seen as it is: a wrong one adds a share to all tilts."""
    truth = posed(3.0, -4.0, 20.0)
    nail, rng = nail_part("Ti6Al4V", 11.0, 5.3), np.random.default_rng(21)
    errors_deg = []
    for seed in range(4):
        fit = accepted(shoot(nail, truth, (1.0, -1.0), seed, dose=4.0), start_beside(truth, rng)).fit
        motion = truth.inverse() @ fit.camera_from_nail
        errors_deg.append(np.degrees(motion.rotation_vector_rad[:2]))
    assert np.abs(np.mean(errors_deg, axis=0)).max() < 0.056  # measured: 0.037


def test_radii_come_out_as_they_are() -> None:
    # measured: at most 0.0030 mm and 0.0049 mm
    for outcome in outcomes():
        assert abs(outcome.fit.evidence.hole_radius_excess_mm) < 0.0045
        assert abs(outcome.fit.evidence.nail_radius_excess_mm) < 0.0074


@pytest.mark.long
def test_what_the_nails_shape_does_to_the_tilt_turns_round_with_the_tilt() -> None:
    """Wider holes or deeper chamfers than were assumed lean the fitted nail by a share of its tilt, in its direction.

    Several images of one nail tell such an error by that, and only if its sign is right.
    """
    by_radius_deg, by_chamfer_deg = [], []
    for tilt_deg in (6.0, -6.0):
        shot = shoot(STEEL, posed(tilt_deg, 0.0, 30.0), (2.0, 1.0), 5, dose=0.3)
        fit = accepted(shot, shot.camera_from_nail).fit
        pull_deg = np.degrees(fit.errors.shape_pull[1])
        by_radius_deg.append(pull_deg[0])
        by_chamfer_deg.append(pull_deg[2])
        of_what_was_free = fit.errors.own_covariance[:9, :9]
        assert np.all(np.linalg.eigvalsh(of_what_was_free) > 0.0)
    print(f"by radius {np.round(by_radius_deg, 4)}, by chamfer {np.round(by_chamfer_deg, 4)} degrees")
    # measured: 0.0129 and -0.0084, 0.0210 and -0.0045
    assert by_radius_deg[0] > 0.0086
    assert by_radius_deg[1] < -0.0056
    assert by_chamfer_deg[0] > 0.0140
    assert by_chamfer_deg[1] < -0.0030


def test_holes_wider_than_the_files_are_told_in_deviations() -> None:
    """The image of 6 mm holes, fitted with a file of 5.94 mm: one standard deviation of the radius more."""
    shot = tilted_shot()
    deviations = []
    for diameter_mm in (6.0, 5.94):
        nail = nail_part("steel", 12.0, diameter_mm)
        fit = accepted(replace(shot, nail=nail), shot.camera_from_nail).fit
        deviations.append(fit.errors.shape_deviations[0])
    assert deviations[1] - deviations[0] == pytest.approx(1.0, abs=0.045)  # measured: 0.97


@cache
def tilted_shot() -> Shot:
    return shoot(STEEL, posed(-2.0, 4.5, 70.0), (1.5, -2.0), 77)


@pytest.mark.parametrize("tilt", [(2.0, -4.5), (-2.0, -4.5), (2.0, 4.5), (0.0, 0.0), (8.0, -8.0)])
def test_starts_at_reflected_tilts_end_at_the_truth(tilt: tuple[float, float]) -> None:
    shot = tilted_shot()
    beside = shot.camera_from_nail.translation_mm + np.array([0.6, -0.5, 4.0])
    start = Transform[Camera, Nail].from_rotation_translation(posed(*tilt, 70.0).rotation, beside)
    assert accepted(shot, start).axis_deg < 0.15  # measured: 0.090 to 0.100


def test_both_holes_are_seen_and_said_to_be() -> None:
    outcome = accepted(tilted_shot(), tilted_shot().camera_from_nail)
    assert {view.id for view in outcome.fit.evidence.holes} == {"distal", "proximal"}
    assert all(view.opening > 0.5 for view in outcome.fit.evidence.holes)
    assert all(view.contrast_to_noise > 3.0 for view in outcome.fit.evidence.holes)


def refused(shot: Shot, nail: NailPart, start: Transform[Camera, Nail], occluders: Occluders) -> set[ReasonCode]:
    result = fit_nail(FitInput(shot.pixels, shot.calibration, nail, occluders), start)
    assert isinstance(result, Rejected), result
    print([reason.message for reason in result.reasons])
    return {reason.code for reason in result.reasons}


@pytest.mark.requirement("REG-03")
@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(nail_part("steel", 13.0, 6.0), id="wider nail"),
        pytest.param(nail_part("steel", 12.0, 5.5), id="smaller holes"),
        pytest.param(nail_part("steel", 12.0, 6.6), id="larger holes", marks=pytest.mark.long),
    ],
)
def test_another_nail_than_the_files_is_refused(wrong: NailPart) -> None:
    shot = tilted_shot()
    codes = refused(shot, wrong, shot.camera_from_nail, shot.occluders)
    assert ReasonCode.NAIL_MODEL_MISMATCH in codes


@pytest.mark.requirement("REG-03")
def test_a_nail_without_holes_there_is_refused() -> None:
    shot = tilted_shot()
    along = Transform[Nail, Nail].from_rotvec(np.zeros(3), [45.0, 0.0, 0.0])
    codes = refused(shot, shot.nail, shot.camera_from_nail @ along, shot.occluders)
    assert ReasonCode.HOLE_NOT_VISIBLE in codes


@pytest.mark.requirement("REG-05")
def test_a_nail_outside_the_image_is_refused() -> None:
    shot = tilted_shot()
    away = Transform[Camera, Nail].from_rotation_translation(shot.camera_from_nail.rotation, [200.0, 0.0, 740.0])
    assert refused(shot, shot.nail, away, shot.occluders) == {ReasonCode.HOLE_NOT_VISIBLE}


# What covers it may have been recognised; if not, both tilts, a display's curve and the image without what is darker
# than the nail are tried before it is refused.
@pytest.mark.requirement("REG-05")
@pytest.mark.parametrize("recognised", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_hole_that_is_covered_is_refused(*, recognised: bool) -> None:
    shot = tilted_shot()
    hole = shot.calibration.image_from_camera(shot.camera_from_nail @ np.array([-15.0, 0.0, 0.0]))
    rows, columns = np.ogrid[: shot.pixels.shape[0], : shot.pixels.shape[1]]
    disc = (columns - hole[0]) ** 2 + (rows - hole[1]) ** 2 < 26.0**2
    pixels = np.where(disc, np.percentile(shot.pixels, 2.0), shot.pixels).astype(np.float32)  # as dark as the nail
    fit_input = FitInput(pixels, shot.calibration, shot.nail, shot.occluders)
    result = fit_nail(fit_input.hiding(disc) if recognised else fit_input, shot.camera_from_nail)
    assert isinstance(result, Rejected), result
    assert ReasonCode.HOLE_NOT_VISIBLE in {reason.code for reason in result.reasons}


def with_wire(shot: Shot, beside_hole_px: float) -> Shot:
    """The same image with a dark stripe across the nail, 1 mm wide, that passes a hole's middle at a distance."""
    hole = shot.calibration.image_from_camera(shot.camera_from_nail @ np.array([-15.0, 0.0, 0.0]))
    rows, columns = np.ogrid[: shot.pixels.shape[0], : shot.pixels.shape[1]]
    away = (columns - hole[0]) * np.cos(0.3) + (rows - hole[1]) * np.sin(0.3) - beside_hole_px
    covered = 0.9 * np.clip(3.5 - np.abs(away), 0.0, 1.0)
    metal = float(np.percentile(shot.pixels, 2.0))
    return replace(shot, pixels=(shot.pixels + covered * (metal - shot.pixels)).astype(np.float32))


@pytest.mark.requirement("REG-05")
@pytest.mark.long
def test_an_evident_object_is_left_out_also_where_the_fit_would_be_accepted_with_it() -> None:
    shot = with_wire(tilted_shot(), 30.0)
    outcome = accepted(shot, start_beside(shot.camera_from_nail, np.random.default_rng(3)))
    evidence, tilt_sd_deg = outcome.fit.evidence, np.degrees(np.sqrt(np.diag(outcome.fit.errors.covariance)[:2]))
    assert evidence.objects_left_out
    assert evidence.error_ratio < 1.2  # measured: 1.0; with the wire in the fit 2.6
    assert tilt_sd_deg.max() < 0.15  # measured: 0.09; with the wire in the fit 0.4
    assert outcome.axis_deg < 0.15  # measured: 0.09
