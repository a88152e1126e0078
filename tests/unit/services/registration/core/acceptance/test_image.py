"""Acceptance of an image: each limit refuses with its own reason, and what is within all limits is accepted."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import NAIL_OUTSIDE
from services.registration.core.acceptance.image import (
    Departures,
    FitEvidence,
    HoleView,
    LocalisationEvidence,
    ResidualStatistics,
    fit_reasons,
    localisation_reasons,
)
from services.registration.core.c_arm_advice import CArmTurn
from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.hole_axes import HoleEstimate
from shared.errors import ReasonCode
from shared.geometry.camera import DisplacementField
from shared.geometry.lines import Line
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import calibration, guide_part, nail_part, posed_nail

NAIL_MM = 12.0
RESIDUAL = ResidualStatistics(1.1, 5.0, 0.1, 0.1)
FIT = FitEvidence(
    (HoleView("distal", 0.9, 12.0), HoleView("proximal", 0.8, 9.0)), RESIDUAL, 0.01, -0.02, 120.0, 1.2, (0.9, 0.8)
)
NAN = float("nan")


def hole(entry_sd_mm: float = 0.05, tilt_deg: float = 3.0, diameter_mm: float = 6.0) -> HoleEstimate:
    entry = np.array([15.0, 0.0, 100.0])
    axis = Line(entry, np.array([0.0, 0.0, 1.0]))
    covariance: NDArray[np.float64] = 0.5 * entry_sd_mm**2 * np.kron(np.array([[1.0, 0.9], [0.9, 1.0]]), np.eye(2))
    offset = AxisOffset(np.zeros(4), covariance, NAIL_MM)
    return HoleEstimate(
        "distal", axis, entry, entry + np.array([0.0, 0.0, NAIL_MM]), diameter_mm, 4.0, tilt_deg, offset
    )


LOCALISED = LocalisationEvidence(
    calibration=calibration(1024),
    guide=guide_part(),
    nail=nail_part(),
    camera_from_nail=posed_nail(10.0),
    guide_from_nail=Transform.from_rotvec(np.zeros(3), [4.0, -3.0, 107.0]),
    holes=(hole(),),
    correction=CArmTurn(3.0, -2.0),
)


def test_noise_that_the_model_does_not_explain_is_no_matter_of_dose() -> None:
    noisy = replace(FIT, holes=(HoleView("distal", 0.9, 1.2), FIT.holes[1]))
    (by_noise,) = fit_reasons(noisy)
    by_object, _ = fit_reasons(replace(noisy, residual=replace(RESIDUAL, spot=0.6)))
    assert by_noise.code is by_object.code is ReasonCode.HOLE_NOT_VISIBLE
    assert "raise the dose" in by_noise.message
    assert "dose" not in by_object.message
    assert "instruments" in by_object.message


def test_a_filter_is_not_taken_for_an_object_and_an_object_not_for_a_filter() -> None:
    doubtful = replace(FIT, objects_left_out=True, error_ratio=3.0, mirror_margin=2.0, rim_shares=(0.9, 0.2))
    beside = fit_reasons(replace(doubtful, residual_tails=1.3))
    filtered = fit_reasons(replace(doubtful, residual_tails=1.6))
    assert [one.code for one in beside] == [
        ReasonCode.HOLE_NOT_VISIBLE,
        ReasonCode.HOLE_NOT_VISIBLE,
        ReasonCode.MIRROR_AMBIGUOUS,
    ]
    assert [one.code for one in filtered] == [
        ReasonCode.HOLE_NOT_VISIBLE,
        ReasonCode.IMAGE_PROCESSED,
        ReasonCode.MIRROR_AMBIGUOUS,
    ]
    assert all("switch off" in one.message and "instruments" not in one.message for one in filtered)
    assert not any("switch off" in one.message for one in beside)
    assert "something dark lies over the nail" in beside[1].message
    assert "a filter against noise was on" in filtered[1].message


def test_correlated_residuals_are_blamed_on_a_filter_where_it_shows() -> None:
    correlated = replace(FIT, residual=replace(RESIDUAL, noise_inflation=12.0))
    (by_object,), (by_filter,) = (fit_reasons(replace(correlated, residual_tails=t)) for t in (1.1, 1.9))
    assert by_object.code is by_filter.code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "does not describe lies there" in by_object.message
    assert "a filter does that; switch off" in by_filter.message


def test_noise_as_blurred_as_the_image_is_no_reason_against_it() -> None:
    assert not fit_reasons(replace(FIT, residual=replace(RESIDUAL, noise_inflation=34.0)))


def test_uncertainty_beside_objects_asks_for_a_free_view() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (reason,) = localisation_reasons(replace(uncertain, departures=Departures(error_ratio=2.2, beside_objects=True)))
    assert "take instruments out of the beam" in reason.message
    assert "switch off" not in reason.message


def test_uncertainty_by_processing_does_not_ask_for_dose() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (by_noise,), (by_processing,) = (
        localisation_reasons(replace(uncertain, departures=Departures(error_ratio=r))) for r in (2.0, 2.1)
    )
    assert by_noise.code is by_processing.code is ReasonCode.UNCERTAINTY_TOO_LARGE
    assert "more dose" in by_noise.message
    assert "disagree by 2.1 times" in by_processing.message
    assert "local contrast" in by_processing.message
    assert "dose" not in by_processing.message


def test_uncertainty_by_a_curve_that_changes_with_the_place_does_not_ask_for_dose() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (by_curve,) = localisation_reasons(replace(uncertain, departures=Departures(display_turn_deg=0.41)))
    assert "may turn the nail by 0.41° (rms)" in by_curve.message
    assert "switch off local contrast enhancement" in by_curve.message
    assert "dose" not in by_curve.message


def test_uncertainty_by_holes_beside_their_places_asks_for_the_nails_file() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (as_filed,), (beside,) = (
        localisation_reasons(replace(uncertain, departures=Departures(hole_spread_mm=s))) for s in (0.03, 0.06)
    )
    assert "more dose" in as_filed.message
    assert "the nail's holes lie 0.06 mm (rms) from where its file has them" in beside.message
    assert "check that the file is that of the implanted nail" in beside.message


def test_uncertainty_by_holes_that_look_bored_twice_says_so() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (once,), (twice,) = (
        localisation_reasons(replace(uncertain, departures=Departures(second_bore_deg=d))) for d in (0.3, 0.9)
    )
    assert "more dose" in once.message
    assert "the holes look bored twice, askew, so that their axes may lie 0.9° (rms) from the estimate" in twice.message
    assert "if a drill has already cut the nail's holes" in twice.message
    assert "dose" not in twice.message


def test_uncertainty_by_a_channel_in_what_fills_the_holes_says_so() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (without,), (with_channel,) = (
        localisation_reasons(replace(uncertain, departures=Departures(channel_deg=d))) for d in (0.3, 0.9)
    )
    assert "more dose" in without.message
    assert "has an edge of its own inside their rims" in with_channel.message
    assert "their axes may lie 0.9° (rms) from the estimate" in with_channel.message
    assert "if that shows the edge as well, lock the holes by hand" in with_channel.message
    assert "dose" not in with_channel.message


@pytest.mark.parametrize("error_ratio", [3.3, 4.1])
def test_parts_that_disagree_a_little_over_displaced_holes_ask_for_the_nails_file(error_ratio: float) -> None:
    by_holes = error_ratio < 4.0
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    departures = Departures(hole_spread_mm=0.06, error_ratio=error_ratio)
    (localised,) = localisation_reasons(replace(uncertain, departures=departures))
    (fitted,) = fit_reasons(replace(FIT, mirror_margin=5.0, hole_spread_mm=0.06, error_ratio=error_ratio))
    for reason in (localised, fitted):
        assert f"parts of the image disagree by {error_ratio} times" in reason.message
        assert ("the nail's holes lie 0.06 mm (rms)" in reason.message) == by_holes
        assert ("check that the file is that of the implanted nail" in reason.message) == by_holes
        assert ("switch off local contrast" in reason.message) != by_holes


@pytest.mark.parametrize(
    ("as_filed", "beside", "names"),
    [
        (
            Departures(guide_spread_mm=0.05),
            Departures(guide_spread_mm=0.12),
            ("the guide's balls lie 0.12 mm (rms per axis)", "measure the guide (`distalock calibrate guide`)"),
        ),
        (
            Departures(ring_spread_mm=0.07),
            Departures(ring_spread_mm=0.15),
            ("the ring's balls lie 0.15 mm (rms per axis)", "measure the ring (`distalock calibrate ring`)"),
        ),
    ],
)
def test_uncertainty_by_balls_beside_their_places_asks_for_their_part(
    as_filed: Departures, beside: Departures, names: tuple[str, str]
) -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (by_noise,), (by_balls,) = (localisation_reasons(replace(uncertain, departures=d)) for d in (as_filed, beside))
    assert "more dose" in by_noise.message
    assert all(name in by_balls.message for name in names)
    assert "dose" not in by_balls.message


def test_uncertainty_by_another_bend_asks_for_another_direction() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (same,), (another,) = (
        localisation_reasons(replace(uncertain, departures=Departures(other_bend_deg=d))) for d in (0.0, 0.8)
    )
    assert "bent otherwise" not in same.message
    assert "its holes by 0.80°" in another.message
    assert "turn the C-arm by 5°" in another.message
    assert "dose" not in another.message


def test_uncertainty_by_lag_asks_for_stillness() -> None:
    uncertain = replace(LOCALISED, holes=(hole(entry_sd_mm=2.0),))
    (lagging,) = localisation_reasons(replace(uncertain, departures=Departures(lag_px=0.42)))
    assert "draw them 0.42 px to one side: earlier frames are in the image" in lagging.message
    assert "still for a second" in lagging.message
    assert "dose" not in lagging.message


def test_a_hole_without_a_rim_share_is_an_error() -> None:
    with pytest.raises(ValueError, match="shorter"):
        fit_reasons(replace(FIT, rim_shares=FIT.rim_shares[:1]))


def test_within_all_limits_is_accepted() -> None:
    assert fit_reasons(FIT) == ()
    assert localisation_reasons(LOCALISED) == ()


@pytest.mark.parametrize(
    ("evidence", "code", "words"),
    [
        (
            replace(FIT, holes=(HoleView("distal", 0.03, 12.0), FIT.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "hole 'distal' shows 3 % (at least 4 %) of its disc",
        ),
        (
            replace(FIT, holes=(HoleView("distal", 0.3, 12.0), HoleView("proximal", 0.2, 9.0))),
            ReasonCode.HOLE_NOT_VISIBLE,
            "hole 'distal' shows 30 % (at least 35 %) of its disc",
        ),
        (
            replace(FIT, holes=(HoleView("distal", 0.9, 1.2), FIT.holes[1])),
            ReasonCode.HOLE_NOT_VISIBLE,
            "brighter than the metal around it by 1.2 (at least 3) standard deviations",
        ),
        (
            replace(FIT, rim_shares=(0.49, 0.3)),
            ReasonCode.HOLE_NOT_VISIBLE,
            "the rim of hole 'distal' is visible over 49 % (at least 50 %) of its length",
        ),
        (
            replace(FIT, rim_shares=(0.5, 0.29)),
            ReasonCode.HOLE_NOT_VISIBLE,
            "the rim of hole 'proximal' is visible over 29 % (at least 30 %) of its length",
        ),
        (
            replace(FIT, error_ratio=12.1),
            ReasonCode.IMAGE_PROCESSED,
            "disagree about the nail's rotation by 12.1 times (limit 12 times) what the noise explains",
        ),
        (
            replace(FIT, error_ratio=2.6, objects_left_out=True),
            ReasonCode.HOLE_NOT_VISIBLE,
            "disagree about the nail's rotation by 2.6 times (limit 2.5 times) what the noise explains",
        ),
        (
            replace(FIT, hole_radius_excess_mm=0.2),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "the holes measure +0.40 mm (limit 0.24 mm) in diameter",
        ),
        (
            replace(FIT, nail_radius_excess_mm=-0.15),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "the nail measures -0.30 mm (limit 0.24 mm) in diameter",
        ),
        (
            replace(FIT, log_attenuation=1.13),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "the nail attenuates at least 3.1 times (limit 2 times) as much as the material in its file",
        ),
        (
            replace(FIT, log_attenuation=-0.75),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "the material in its file attenuates at least 2.1 times (limit 2 times) as much as the nail",
        ),
        (
            replace(FIT, residual=replace(RESIDUAL, structure=2.1)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "edges of nail and holes is 2.1 times (limit 2 times) that elsewhere",
        ),
        (
            replace(FIT, residual=replace(RESIDUAL, noise_inflation=14.0), residual_tails=1.1),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "over 14.0 pixels (limit 10 pixels)",
        ),
        (
            replace(FIT, residual=replace(RESIDUAL, noise_inflation=64.0)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "over 64.0 pixels (limit 60 pixels): something that the nail file does not describe lies there, or the",
        ),
        (
            replace(FIT, residual=replace(RESIDUAL, spot=0.7)),
            ReasonCode.NAIL_MODEL_MISMATCH,
            "by 70 % (limit 30 %) of the step from metal to background",
        ),
        (replace(FIT, mirror_margin=3.0), ReasonCode.MIRROR_AMBIGUOUS, "likelihood ratio 3.0 (at least 8)"),
        (
            replace(FIT, bent_margin=-0.4),
            ReasonCode.MIRROR_AMBIGUOUS,
            "explains the image better than a straight one: logarithm of the likelihood ratio -0.4 (at least 0)",
        ),
        (
            replace(FIT, straight_margin=28.0),
            ReasonCode.MIRROR_AMBIGUOUS,
            "explains the image nearly as well as a bent one: logarithm of the likelihood ratio 28.0 (at least 40)",
        ),
    ],
)
def test_each_limit_of_the_fit_has_its_reason(evidence: FitEvidence, code: ReasonCode, words: str) -> None:
    reasons = fit_reasons(evidence)
    assert [reason.code for reason in reasons] == [code]
    assert words in reasons[0].message


@pytest.mark.parametrize(
    "evidence",
    [
        replace(FIT, holes=(HoleView("distal", 0.35, 3.0), HoleView("proximal", 0.12, 3.0))),
        replace(FIT, hole_radius_excess_mm=0.12, nail_radius_excess_mm=-0.12),
        replace(FIT, log_attenuation=float(np.log(2.0))),
        replace(FIT, residual=ResidualStatistics(2.0, 10.0, 0.3, 0.1)),
        replace(FIT, mirror_margin=8.0),
        replace(FIT, bent_margin=0.0),
        replace(FIT, straight_margin=40.0),
        replace(FIT, holes=FIT.holes[:1], rim_shares=(0.9,), mirror_margin=40.0),
    ],
)
def test_values_exactly_at_the_limits_of_the_fit_are_accepted(evidence: FitEvidence) -> None:
    assert fit_reasons(evidence) == ()


def test_the_reason_of_an_ambiguous_tilt_names_the_other_explanation() -> None:
    (of_two,) = fit_reasons(replace(FIT, mirror_margin=7.9))
    assert of_two.message.startswith("the reflected tilt explains the image nearly as well")
    (of_one,) = fit_reasons(replace(FIT, holes=FIT.holes[:1], rim_shares=(0.9,), mirror_margin=39.9))
    assert of_one.message.startswith("the nail has one hole, and another tilt explains the image nearly as well")


def test_neither_dose_nor_a_turn_is_blamed_where_the_display_is_the_cause() -> None:
    processed = replace(FIT, error_ratio=4.3)
    faint = replace(processed, holes=(replace(FIT.holes[0], contrast_to_noise=1.4), FIT.holes[1]))
    for evidence in (faint, replace(processed, mirror_margin=3.0)):
        (reason,) = fit_reasons(evidence)
        assert "switch off local contrast enhancement" in reason.message
        assert "dose" not in reason.message
        assert "turn the C-arm" not in reason.message
    assert "disagree by 4.3 times" in fit_reasons(replace(processed, mirror_margin=3.0))[0].message


def test_one_hole_in_full_and_a_part_of_the_other_are_enough() -> None:
    assert fit_reasons(replace(FIT, holes=(HoleView("distal", 0.15, 12.0), FIT.holes[1]))) == ()


@pytest.mark.parametrize(("margin", "codes"), [(39.0, [ReasonCode.MIRROR_AMBIGUOUS]), (41.0, [])])
def test_one_hole_alone_must_be_clearer_than_two(margin: float, codes: list[ReasonCode]) -> None:
    found = fit_reasons(replace(FIT, holes=FIT.holes[:1], rim_shares=(0.9,), mirror_margin=margin))
    assert [reason.code for reason in found] == codes
    assert fit_reasons(replace(FIT, mirror_margin=margin)) == ()


@pytest.mark.parametrize(
    "evidence",
    [
        replace(FIT, holes=(HoleView("distal", NAN, 12.0), FIT.holes[1])),
        replace(FIT, holes=(HoleView("distal", 0.9, NAN), FIT.holes[1])),
        replace(FIT, hole_radius_excess_mm=NAN),
        replace(FIT, nail_radius_excess_mm=NAN),
        replace(FIT, log_attenuation=NAN),
        replace(FIT, residual=replace(RESIDUAL, structure=NAN)),
        replace(FIT, residual=replace(RESIDUAL, noise_inflation=NAN)),
        replace(FIT, residual=replace(RESIDUAL, spot=NAN)),
        replace(FIT, mirror_margin=NAN),
        replace(FIT, bent_margin=NAN),
        replace(FIT, straight_margin=NAN),
    ],
)
def test_what_is_no_number_is_refused(evidence: FitEvidence) -> None:
    assert len(fit_reasons(evidence)) >= 1


def test_a_nail_outside_the_image_says_what_to_do() -> None:
    assert NAIL_OUTSIDE.reason().code is ReasonCode.HOLE_NOT_VISIBLE
    assert "lie outside the image" in NAIL_OUTSIDE.reason().message


@pytest.mark.requirement("REG-13")
def test_a_tilt_is_refused_with_the_turn_that_removes_it() -> None:
    (reason,) = localisation_reasons(replace(LOCALISED, holes=(hole(tilt_deg=14.1),)))
    assert reason.code is ReasonCode.TILT_TOO_LARGE
    assert "is tilted by 14.1° (limit 14°)" in reason.message
    assert "turn the C-arm by +3.0° about the image's x axis and -2.0° about its y axis" in reason.message


def test_a_tilt_exactly_at_its_limit_is_accepted() -> None:
    assert localisation_reasons(replace(LOCALISED, holes=(hole(tilt_deg=14.0),))) == ()


@pytest.mark.requirement("REG-01")
@pytest.mark.parametrize(
    "one",
    [
        hole(entry_sd_mm=0.6),  # the bound of 1 mm
        hole(entry_sd_mm=0.3, diameter_mm=5.0),  # the chance to pass a narrow hole
        replace(hole(), offset=AxisOffset(np.zeros(4), np.diag([0.0, 0.0, 0.04, 0.04]), NAIL_MM)),  # the angle
    ],
)
def test_too_uncertain_is_refused(one: HoleEstimate) -> None:
    (reason,) = localisation_reasons(replace(LOCALISED, holes=(one,)))
    assert reason.code is ReasonCode.UNCERTAINTY_TOO_LARGE
    for limit in ("(limit 1 mm)", "(limit 1.5°)", "(at least 0.99)"):
        assert limit in reason.message
    assert "a 4 mm drill would pass it" in reason.message


def test_the_drill_decides_about_a_narrow_hole() -> None:
    narrow = hole(entry_sd_mm=0.3, diameter_mm=5.0)
    assert localisation_reasons(replace(LOCALISED, holes=(replace(narrow, drill_diameter_mm=3.0),))) == ()


def test_a_method_without_an_estimate_of_its_errors_is_refused() -> None:
    (reason,) = localisation_reasons(replace(LOCALISED, holes=(replace(hole(), offset=None),)))
    assert reason.code is ReasonCode.UNCERTAINTY_TOO_LARGE
    assert "fronto-parallel" in reason.message


def test_holes_beyond_the_rings_balls_are_refused() -> None:
    uncertain = DisplacementField(np.zeros(2), 256.0, np.zeros((5, 5, 2)), np.full((5, 5), 0.8))
    found = localisation_reasons(replace(LOCALISED, calibration=calibration(1024, uncertain)))
    assert {reason.code for reason in found} == {ReasonCode.CALIBRATION_EXTRAPOLATED}
    assert "uncertain by 0.80 px (limit 0.5 px)" in found[0].message


def test_ids_that_guide_and_nail_give_to_opposite_holes_are_refused() -> None:
    (reason,) = localisation_reasons(replace(LOCALISED, nail=nail_part(hole_x_mm=(-12.0, 12.0))))
    assert reason.code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "the nail's file goes +24.0 mm along the guide's x axis and the guide's file -30.0 mm" in reason.message


@pytest.mark.parametrize(("apart_mm", "refused"), [(-0.01, True), (0.0, False), (0.01, False)])
def test_the_order_of_holes_is_that_along_the_guides_own(apart_mm: float, *, refused: bool) -> None:
    """Holes of the nail that lie on one another have no order; where the second one lies decides, not how far."""
    found = localisation_reasons(replace(LOCALISED, nail=nail_part(hole_x_mm=(apart_mm, 0.0))))
    assert [reason.code for reason in found] == [ReasonCode.NAIL_MODEL_MISMATCH] * refused


def test_distortion_that_displaced_balls_leave_uncertain_asks_for_the_ring() -> None:
    uncertain = DisplacementField(np.zeros(2), 256.0, np.zeros((5, 5, 2)), np.full((5, 5), 0.8))
    displaced = Departures(ring_spread_mm=0.12)
    found = localisation_reasons(replace(LOCALISED, calibration=calibration(1024, uncertain), departures=displaced))
    assert "the ring's balls lie 0.12 mm (rms per axis) from where its file has them" in found[0].message
    assert "`distalock calibrate ring`" in found[0].message
    assert "centre" not in found[0].message
