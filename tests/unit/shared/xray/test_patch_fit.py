"""Fits in one go are those of the groups; what cannot be fitted is not made up."""

import numpy as np
import pytest

from shared.xray.disc_kernel import fit_constants
from shared.xray.disc_model import BACKGROUND_TERMS
from shared.xray.discs import DiscPriors, fit_discs
from shared.xray.patch_fit import FIT_CONTRAST, FIT_CONTRAST_SD, FIT_NOISE, FIT_RADIUS, FIT_SD, fit_each, priors_vector
from tests.unit.shared.xray.discs_image import image_of_discs

CENTRE = np.array([[40.3, 41.2], [80.6, 44.9]])
RADIUS = np.array([5.0, 4.0])
BLUR = (1.5, 0.8)


def known() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.column_stack([CENTRE + 0.4, np.full(2, 1.5), RADIUS, 0.25 * RADIUS])


def test_each_disc_is_fitted_as_a_group_of_one_is() -> None:
    pixels = image_of_discs(CENTRE, RADIUS, noise=0.004, seed=1, size_px=120)
    usable = np.ones(pixels.shape, bool)
    found = fit_each(pixels, usable, known(), BLUR, 3.0, 1, fit_constants())
    for k, row in enumerate(known()):
        priors = DiscPriors(row[None, :2], row[2:3], row[3:4], row[4:5], *BLUR)
        fit = fit_discs(pixels, usable, priors, (row[None, :2], row[3:4] + 3.0), passes=1)
        assert fit is not None
        assert found[k, :2] == pytest.approx(fit.centre_px[0], abs=1e-9)
        assert found[k, FIT_RADIUS] == pytest.approx(fit.radius_px[0])
        assert found[k, FIT_CONTRAST] == pytest.approx(fit.contrast[0])
        assert found[k, FIT_CONTRAST_SD] == pytest.approx(fit.contrast_sd[0])
        assert found[k, FIT_NOISE] == pytest.approx(fit.noise)
        assert found[k, FIT_SD] == pytest.approx(np.sqrt(0.5 * np.trace(fit.centre_covariance_px2[0])))
    assert found[:, :2] == pytest.approx(CENTRE, abs=0.2)


def test_a_disc_without_usable_pixels_is_not_a_number() -> None:
    pixels = image_of_discs(CENTRE, RADIUS, noise=0.004, seed=2, size_px=120)
    usable = np.ones(pixels.shape, bool)
    usable[:, 65:] = False
    found = fit_each(pixels, usable, known(), BLUR, 3.0, 1, fit_constants())
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_what_is_known_stands_where_the_kernel_looks_for_it() -> None:
    mean, precision = priors_vector(known(), BLUR, 0.7, fit_constants())
    first = BACKGROUND_TERMS + 2
    assert mean[0] == 0.7
    assert mean[first:-2] == pytest.approx(known()[:, [0, 1, 3]].T.ravel())
    assert precision[first:-2] ** -0.5 == pytest.approx(known()[:, [2, 2, 4]].T.ravel())
    assert (mean[-1], precision[-1] ** -0.5) == pytest.approx(BLUR)
