"""Values in sentences never read as the limit that they miss."""

import math

import pytest

from shared.figures import figure


@pytest.mark.parametrize(
    ("measured", "limit", "decimals", "text"),
    [
        (1.234, 1.0, 2, "1.23"),
        (1.004, 1.0, 2, "1.004"),
        (0.94996, 0.95, 3, "0.94996"),
        (59.7, 100.0 * 0.6, 0, "59.7"),
        (0.13, 0.12, 1, "0.13"),
        (-5.0, 3.0, 1, "-5.0"),
        (-3.02, 3.0, 1, "-3.02"),
        (3.0, 3.0, 1, "3.0"),
        (3.0 + 1e-9, 3.0, 1, "3.0"),
        (math.inf, 1.0, 2, "inf"),
        (math.nan, 1.0, 2, "nan"),
    ],
)
def test_a_value_has_the_decimals_that_tell_it_from_its_limit(
    measured: float, limit: float, decimals: int, text: str
) -> None:
    assert figure(measured, limit, decimals) == text
