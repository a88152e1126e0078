"""The sensitivity benchmark: which values change, by how much, and what counts as an effect."""

import pytest

from benchmarks.accuracy.sensitivity import FACTORS, Row, changed_row, effect_of, key_of, scaled, tuned_numbers


@pytest.mark.parametrize(
    ("value", "larger", "smaller"),
    [(10.0, 13.0, 7.0), (10, 13, 7), (1, 2, 0), ((2.0, 4), (2.6, 5), (1.4, 3)), (True, None, None), ("a", None, None)],
)
def test_numbers_change_by_a_share_and_integers_by_at_least_one(value: object, larger: object, smaller: object) -> None:
    assert scaled(value, 1.3) == (pytest.approx(larger) if larger is not None else None)
    assert scaled(value, 0.7) == (pytest.approx(smaller) if smaller is not None else None)


def test_every_change_has_a_name_of_its_own() -> None:
    keys = [key_of(one, factor) for one in tuned_numbers() for factor in FACTORS]
    assert keys
    assert len(set(keys)) == len(keys)


def row(entry_mm: float, codes: tuple[str, ...] = (), error_mm: float = 0.1) -> Row:
    hole = {"entry_mm": [entry_mm, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "entry_sd_mm": 0.1, "axis_sd_deg": 0.1}
    return [{"verdict": "accepted", "codes": codes, "holes": {"distal": hole}, "entry_errors_mm": [error_mm]}]


def test_effects_are_differences_from_the_values_as_declared() -> None:
    effect = effect_of(row(0.0), row(0.05, ("tilt_too_large",), 0.3))
    assert effect.verdicts == 1
    assert effect.shift_sd == pytest.approx(0.5)
    assert effect.worst_mm == pytest.approx(0.2)
    assert not effect.none
    assert effect_of(row(0.0), row(0.0)).none


def test_what_a_change_raises_is_a_result() -> None:
    assert effect_of(row(0.0), [{"failure": "ValueError: x"}]).failure == "ValueError: x"
    assert "FileNotFoundError" in str(changed_row("/none", "as declared")[0]["failure"])
