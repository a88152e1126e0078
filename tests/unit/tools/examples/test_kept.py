"""Examples of the API are replaced where their shape changed, and nowhere else."""

from tools.examples.kept import with_changed

_BEFORE = {"read_case": {"answer": {"case_id": "case-1", "age_s": 1, "holes": [{"id": "distal"}]}}}


def test_an_example_with_other_values_stays() -> None:
    now = {"read_case": {"answer": {"case_id": "case-2", "age_s": 0.5, "holes": [{"id": "a"}, {"id": "b"}]}}}
    assert with_changed(_BEFORE, now) == _BEFORE


def test_a_member_more_another_kind_or_a_list_with_items_of_another_shape_replaces_it() -> None:
    for answer in (
        {"case_id": "case-1", "age_s": 1, "holes": [{"id": "distal"}], "side": "left"},
        {"case_id": "case-1", "age_s": None, "holes": [{"id": "distal"}]},
        {"case_id": "case-1", "age_s": 1, "holes": [{"id": "distal", "open": True}]},
        {"case_id": "case-1", "age_s": 1, "holes": []},
    ):
        now = {"read_case": {"answer": answer}}
        assert with_changed(_BEFORE, now) == now


def test_a_new_one_comes_and_one_that_was_not_recorded_goes() -> None:
    now = {"read_robot": {"answer": {"state": "locked"}}}
    assert with_changed(_BEFORE, now) == now
