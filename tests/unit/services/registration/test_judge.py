"""The verdict: each limit refuses with its own reason, and what is within all limits is accepted."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.alignment import CArmTurn
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.judge import judge
from services.registration.core.nail_estimate import Misfit, NailEstimate
from services.registration.core.passing import AxisOffset
from shared.errors import Reason, ReasonCode
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import DisplacementField
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line
from shared.geometry.transform import Transform
from tests.unit.services.registration.stated_errors import errors_without_shape
from tests.unit.services.registration.xray_scene import calibration, guide_part, nail_part, posed_nail

NAIL_MM = 12.0
VIEW = calibration(1024)
TURN = CArmTurn(3.0, -2.0)
GOOD_FIT = Misfit(0.02, -0.03, 1.2)
ERRORS = errors_without_shape(np.eye(6), np.zeros((6, 6)))
BEHIND_THE_GUIDE: Transform[Guide, Nail] = Transform.from_rotvec(np.zeros(3), [4.0, -3.0, 107.0])


def hole(entry_sd_mm: float = 0.05, tilt_deg: float = 3.0, diameter_mm: float = 6.0) -> HoleEstimate:
    entry = np.array([15.0, 0.0, 100.0])
    axis = Line(entry, np.array([0.0, 0.0, 1.0]))
    covariance: NDArray[np.float64] = 0.5 * entry_sd_mm**2 * np.kron(np.array([[1.0, 0.9], [0.9, 1.0]]), np.eye(2))
    offset = AxisOffset(np.zeros(4), covariance, NAIL_MM)
    return HoleEstimate("distal", axis, entry, entry + np.array([0.0, 0.0, NAIL_MM]), diameter_mm, tilt_deg, offset)


def reasons(
    estimate_misfit: Misfit | None = GOOD_FIT, one: HoleEstimate | None = None, view: CArmCalibration = VIEW
) -> tuple[Reason, ...]:
    estimate = NailEstimate(posed_nail(10.0), ERRORS, 50.0, estimate_misfit)
    return judge(view, guide_part(), nail_part(), BEHIND_THE_GUIDE, estimate, (one or hole(),), TURN)


def test_within_all_limits_is_accepted() -> None:
    assert reasons() == ()


@pytest.mark.parametrize(
    "misfit", [Misfit(0.13, 0.0, 1.0), Misfit(0.0, -0.13, 1.0), Misfit(0.0, 0.0, 2.1), Misfit(0.0, 0.0, float("nan"))]
)
def test_what_the_model_cannot_explain_is_refused(misfit: Misfit) -> None:
    (reason,) = reasons(misfit)
    assert reason.code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "remove wires" in reason.message


def test_tilt_is_refused_with_the_turn_that_heals_it() -> None:
    (reason,) = reasons(one=hole(tilt_deg=14.1))
    assert reason.code is ReasonCode.TILT_TOO_LARGE
    assert "turn the C-arm by +3.0° about the image's x axis and -2.0° about its y axis" in reason.message


@pytest.mark.parametrize(
    "one",
    [
        hole(entry_sd_mm=0.6),  # the bound of 1 mm
        hole(entry_sd_mm=0.3, diameter_mm=5.0),  # the chance to pass a narrow hole
        replace(hole(), offset=AxisOffset(np.zeros(4), np.diag([0.0, 0.0, 0.04, 0.04]), NAIL_MM)),  # the angle
    ],
)
def test_too_uncertain_is_refused(one: HoleEstimate) -> None:
    (reason,) = reasons(one=one)
    assert reason.code is ReasonCode.UNCERTAINTY_TOO_LARGE
    assert "with 95 % confidence (limits 1 mm and 1.5°)" in reason.message


def test_a_method_that_does_not_know_its_errors_is_refused() -> None:
    (reason,) = reasons(None, replace(hole(), offset=None))
    assert reason.code is ReasonCode.UNCERTAINTY_TOO_LARGE
    assert "fronto-parallel" in reason.message


def test_holes_beyond_the_rings_balls_are_refused() -> None:
    grid = (5, 5)
    unsure = DisplacementField(np.zeros(2), 256.0, np.zeros((*grid, 2)), np.full(grid, 0.8))
    found = reasons(view=calibration(1024, unsure))
    assert {reason.code for reason in found} == {ReasonCode.CALIBRATION_EXTRAPOLATED}
    assert "uncertain by 0.80 px (limit 0.5)" in found[0].message


def test_ids_that_guide_and_nail_give_to_opposite_holes_are_refused() -> None:
    estimate = NailEstimate(posed_nail(10.0), ERRORS, 50.0, GOOD_FIT)
    exchanged = nail_part(hole_x_mm=(-12.0, 12.0))
    (reason,) = judge(VIEW, guide_part(), exchanged, BEHIND_THE_GUIDE, estimate, (hole(),), TURN)
    assert reason.code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "the nail's file goes +24.0 mm along the guide's x axis and the guide's file -30.0 mm" in reason.message


@pytest.mark.parametrize(("margin", "codes"), [(39.0, [ReasonCode.MIRROR_AMBIGUOUS]), (41.0, [])])
def test_one_hole_alone_must_be_clearer_than_two(margin: float, codes: list[ReasonCode]) -> None:
    one_hole = nail_part(hole_x_mm=(15.0,))
    estimate = NailEstimate(posed_nail(10.0), ERRORS, margin, GOOD_FIT)
    found = judge(VIEW, guide_part(), one_hole, BEHIND_THE_GUIDE, estimate, (hole(),), TURN)
    assert [reason.code for reason in found] == codes
    two = judge(VIEW, guide_part(), nail_part(), BEHIND_THE_GUIDE, estimate, (hole(),), TURN)
    assert two == ()
