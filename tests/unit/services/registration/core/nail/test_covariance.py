"""Errors of a fit whose chamfers are deeper than usual."""

import numpy as np
import pytest

from services.registration.core.estimation.pose_estimate import PoseErrors
from services.registration.core.nail.covariance import with_chamfers_as_seen
from services.registration.core.tuning import NAIL_PRIORS

# By a chamfer deeper by one standard deviation: a turn about x, in rad, and of the depth what the fit does not keep.
TURN_RAD, LOST = 0.002, 0.4


def errors(deviation: float, *, lost: float = LOST) -> PoseErrors:
    pull = np.zeros((9, 3))
    pull[0, 2], pull[8, 2] = TURN_RAD, lost
    return PoseErrors(np.array([3.0, 3.0, deviation]), 1e-8 * np.eye(9), pull, np.zeros((9, 1)))


@pytest.mark.parametrize("deviation", [0.0, 1.34, -1.34, -6.0])
def test_chamfers_within_their_prior_change_nothing(deviation: float) -> None:
    grown = with_chamfers_as_seen(errors(deviation))
    assert np.array_equal(grown.covariance, errors(deviation).covariance)


@pytest.mark.parametrize("true_deviation", [4.0, 6.0])
def test_chamfers_far_beyond_their_prior_turn_the_nail_by_what_the_fit_does_not_keep(true_deviation: float) -> None:
    """Where noise is nothing, the turn that is predicted is the one that a chamfer so deep causes, within a seventh."""
    kept = 1.0 - LOST
    grown = with_chamfers_as_seen(errors(kept * true_deviation)).covariance
    noise_of_depth = LOST / kept  # of an unshrunk estimate, in variances of the prior
    expected = true_deviation**2 + 1.0 - NAIL_PRIORS.usual_chamfer_chi_square * (1.0 + noise_of_depth)
    assert grown[0, 0] == pytest.approx(1e-8 + TURN_RAD**2 * expected, rel=1e-9)
    assert np.sqrt(grown[0, 0]) / TURN_RAD == pytest.approx(true_deviation, rel=0.15)
    assert np.allclose(grown[1:, 1:], errors(0.0).covariance[1:, 1:])


@pytest.mark.parametrize("lost", [1.0, 1.0 + 1e-15, 1.0 - 1e-15])
def test_where_no_rim_is_seen_the_chamfers_depth_changes_nothing(lost: float) -> None:
    """A fit that is stopped before it converges may keep a depth that the image shows nothing of."""
    grown = with_chamfers_as_seen(errors(0.3, lost=lost))
    assert np.array_equal(grown.covariance, errors(0.3).covariance)
