"""Values in sentences never read as the limit that they miss."""

import math

import pytest

from shared.figures import figure, figures


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


def test_a_value_above_zero_has_its_sign_where_it_is_wanted() -> None:
    assert figure(0.2406, 0.24, 2, "+") == "+0.241"
    assert figure(-0.3, 0.24, 2, "+") == "-0.30"


@pytest.mark.parametrize(
    ("measured", "limit", "decimals", "texts"),
    [
        (29.16, 28.78, 0, ("29.2", "28.8")),
        (43.53, 43.52, 0, ("43.53", "43.52")),
        (90.0, 28.78, 0, ("90", "29")),
        (2.04, 2.0, 1, ("2.04", "2.00")),
        (2.0, 2.0, 1, ("2.0", "2.0")),
        (math.nan, 2.0, 1, ("nan", "2.0")),
    ],
)
def test_a_limit_that_is_worked_out_gets_decimals_with_the_value(
    measured: float, limit: float, decimals: int, texts: tuple[str, str]
) -> None:
    assert figures(measured, limit, decimals) == texts
