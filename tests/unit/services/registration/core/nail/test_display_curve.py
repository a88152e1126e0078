"""A display's curve that changes from place to place is undone where parts of the image disagree because of it."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail import fit
from services.registration.core.nail.display_curve import DisplayCurve, display_curve_of
from services.registration.core.nail.fit import measure_nail
from services.registration.core.nail.image_fit import ImageFit, NailFit, fit_image
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import DISPLAY_CURVE
from shared.errors import Accepted, Rejected
from shared.geometry.frames import Nail
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_NAIL, SIZE_PX, rendered_parts, turned_nail
from tests.unit.services.registration.xray_scene import Scene, calibration, render

PARTS, VIEW = rendered_parts(), calibration(SIZE_PX)


@cache
def plain() -> NDArray[np.float32]:
    return render(Scene(SIZE_PX, PARTS.nail, CAMERA_FROM_NAIL), VIEW, 5)


@cache
def with_local_contrast() -> NDArray[np.float32]:
    """Histogram equalisation with limited contrast, tile by tile, as displays have it."""
    bytes_ = np.rint(255.0 * plain() / plain().max()).astype(np.uint8)
    shown = cv2.createCLAHE(3.0, (4, 4)).apply(bytes_)
    return np.asarray(shown, dtype=np.float32) / np.float32(255.0)


def fit_input(pixels: NDArray[np.float32]) -> FitInput:
    return FitInput(pixels, VIEW, PARTS.nail, Occluders(None, PARTS.ring))


def fitted(pixels: NDArray[np.float32]) -> NailFit:
    found = measure_nail(fit_input(pixels), turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    return found.value


@cache
def first_fit(image: Callable[[], NDArray[np.float32]]) -> ImageFit:
    """An image's fit as it is shown."""
    found = fit_image(fit_input(image()), turned_nail((3.0, -1.5)))
    assert not isinstance(found, Rejected)
    return found


def share_unlike_plain(pixels: NDArray[np.float32]) -> float:
    """What is left of the plain image, of its spread, when a straight line brings an image as close to it as it can."""
    design = np.stack([pixels.ravel(), np.ones(pixels.size)], axis=1).astype(np.float64)
    wanted = plain().ravel().astype(np.float64)
    left = wanted - design @ np.linalg.lstsq(design, wanted, rcond=None)[0]
    return float(left.std() / wanted.std())


@pytest.mark.long
def test_local_contrast_is_seen_at_the_edges_and_undone() -> None:
    shown = with_local_contrast()
    curve = display_curve_of(first_fit(with_local_contrast).end.solution.linear, shown)
    assert curve.explained_share > 0.6  # measured: 0.79 to 0.81, with noise of a millionth added or not
    assert share_unlike_plain(curve.undone(shown)) < 0.9 * share_unlike_plain(shown)  # measured: 0.80
    # measured: 0.33; on plain independent images 0.25 at most, and in the median 0.10
    of_plain = display_curve_of(first_fit(plain).end.solution.linear, plain())
    assert of_plain.explained_share < DISPLAY_CURVE.least_explained_share


@pytest.mark.requirement("REG-06")
@pytest.mark.parametrize(
    ("disagreements", "kept", "fits"),
    [
        ((1.4,), 1.4, 0),  # parts agree
        ((6.0, 5.0, 4.0, 3.5), 6.0, 3),  # less, but still more than may be left
        ((6.0, 2.5, 2.4, 2.2), 2.5, 3),  # hardly less than the best
        ((6.0, 4.0, 2.9, 2.1), 2.1, 3),  # each fit goes on from the one before it
        ((6.0, 1.2), 1.2, 1),  # parts agree
        ((3.4, 2.8, 2.6, 2.5), 2.6, 3),  # hardly less than as shown
    ],
)
def test_a_curve_is_undone_only_where_parts_agree_better_without_it(
    monkeypatch: pytest.MonkeyPatch, disagreements: tuple[float, ...], kept: float, fits: int
) -> None:
    first = first_fit(with_local_contrast)
    as_shown, *later = (with_disagreement(first, ratio) for ratio in disagreements)
    repeated = Mock(side_effect=later)
    monkeypatch.setattr(fit, "fit_image", repeated)
    found = fit._without_display_curve(fit_input(with_local_contrast()), as_shown).chosen
    assert not isinstance(found, Rejected)
    assert found.fit.evidence.error_ratio == kept
    assert repeated.call_count == fits


def test_a_plain_image_is_fitted_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    # another renderer's image: parts of it disagree, but not because of a curve
    found = fitted(plain())
    monkeypatch.setattr(fit, "DISPLAY_CURVE", replace(DISPLAY_CURVE, most_rounds=0))
    assert np.array_equal(found.camera_from_nail.matrix, fitted(plain()).camera_from_nail.matrix)


def test_a_curve_that_is_left_turns_the_nail_by_as_much_as_it_changes_with_the_place() -> None:
    shown = fit_input(with_local_contrast())
    first = first_fit(with_local_contrast)
    curve = display_curve_of(first.end.solution.linear, shown.pixels)
    grown = fit._grown(shown, first, fit._Fits(first, first)).errors.covariance - first.fit.errors.covariance
    assert np.sqrt(np.diag(grown)[:2]) == pytest.approx(np.radians(DISPLAY_CURVE.turn_deg * curve.change), rel=1e-6)
    assert 0.01 < curve.change < DISPLAY_CURVE.largest_change


def test_another_fit_that_is_as_good_makes_the_nail_uncertain_by_where_it_lies() -> None:
    shown, first = fit_input(with_local_contrast()), first_fit(with_local_contrast)
    near, far = (turned_fit(first, turn_rad) for turn_rad in (0.004, -0.01))
    alone = fit._grown(shown, first, fit._Fits(first, first)).errors.covariance
    grown = fit._grown(shown, first, fit._Fits(first, first, (near, far))).errors.covariance - alone
    assert np.sqrt(grown[0, 0]) == pytest.approx(0.01)
    assert np.allclose(grown[1:, 1:], 0.0, atol=1e-12)


def turned_fit(first: ImageFit, turn_rad: float) -> ImageFit:
    turn: Transform[Nail, Nail] = Transform.exp(np.array([turn_rad, 0.0, 0.0, 0.0, 0.0, 0.0]))
    turned = first.fit.camera_from_nail @ turn
    return replace(first, fit=replace(first.fit, camera_from_nail=turned))


@pytest.mark.parametrize(
    ("disagreements", "as_good"),
    [
        ((5.2, 4.5, 2.9, 3.1), [3.1]),
        ((6.0, 4.0, 2.9, 2.1), []),
        ((3.4, 2.8, 2.6, 2.5), [2.8, 2.5]),
        ((1.4,), []),
    ],
)
def test_fits_that_leave_about_as_little_disagreement_are_kept_beside_the_best(
    monkeypatch: pytest.MonkeyPatch, disagreements: tuple[float, ...], as_good: list[float]
) -> None:
    first = first_fit(with_local_contrast)
    as_shown, *later = (with_disagreement(first, ratio) for ratio in disagreements)
    monkeypatch.setattr(fit, "fit_image", Mock(side_effect=later))
    fits = fit._without_display_curve(fit_input(with_local_contrast()), as_shown)
    assert [one.fit.evidence.error_ratio for one in fits.others] == as_good


def with_disagreement(first: ImageFit, ratio: float) -> ImageFit:
    return replace(first, fit=replace(first.fit, evidence=replace(first.fit.evidence, error_ratio=ratio)))


def test_how_much_a_curve_changes_is_a_share_of_its_levels_range() -> None:
    corrections = np.zeros((6, 2))
    corrections[0] = 7.0
    corrections[2], corrections[4] = (0.3, 0.0), (0.4, 0.5)
    curve = DisplayCurve(np.array([1.0, 3.0]), corrections, np.zeros(2), 10.0, 1.0)
    assert curve.change == pytest.approx(0.25)


def test_what_is_undone_depends_on_grey_value_and_place() -> None:
    corrections = np.zeros((6, 2))
    corrections[0] = 0.1, 0.3  # everywhere
    corrections[1] = 0.0, 0.2  # towards larger columns
    corrections[5] = 0.05, 0.0  # with the square of the row
    curve = DisplayCurve(np.array([1.0, 2.0]), corrections, np.array([10.0, 20.0]), 10.0, 1.0)
    grey = np.full((41, 21), 1.5, dtype=np.float32)
    undone = curve.undone(grey)
    assert undone[20, 10] == pytest.approx(1.5 + 0.2)
    assert undone[20, 20] == pytest.approx(1.5 + 0.2 + 0.1)
    assert undone[25, 10] == pytest.approx(1.5 + 0.2 + 0.25 * 0.025)
    # beyond the reach it is as at its end, beyond the levels as at theirs
    assert undone[40, 10] == pytest.approx(1.5 + 0.2 + 0.025)
    assert curve.undone(np.full((21, 11), 3.0, dtype=np.float32))[20, 10] == pytest.approx(3.3)
