"""Nail files: what they may say of chamfers."""

import json
from importlib.resources import files

import pytest

from shared.errors import PartFileInvalid
from shared.parts.files import nail_from_json

TEXT = (files("shared.parts") / "catalogue" / "nail-femur-ti-10.json").read_text()


def with_chamfer(value: object) -> bytes:
    part = json.loads(TEXT)
    for hole in part["holes"]:
        hole["chamfer_mm"] = value
    return json.dumps(part).encode()


def test_a_stated_chamfer_is_taken_over() -> None:
    assert [hole.chamfer_mm for hole in nail_from_json(with_chamfer(0.25)).holes] == [0.25, 0.25]


def test_a_file_need_not_state_it() -> None:
    part = json.loads(TEXT)
    for hole in part["holes"]:
        del hole["chamfer_mm"]
    assert [hole.chamfer_mm for hole in nail_from_json(json.dumps(part).encode()).holes] == [None, None]


def test_a_part_may_carry_a_name() -> None:
    part = json.loads(TEXT) | {"name": "Femoral nail, titanium, 10 mm"}
    assert nail_from_json(json.dumps(part).encode()).diameter_mm == 10.0
    with pytest.raises(PartFileInvalid, match="name: String should have at most 64 characters"):
        nail_from_json(json.dumps(part | {"name": "x" * 65}).encode())


@pytest.mark.parametrize("value", [-0.1, 2.5, "deep", float("nan")])
def test_a_chamfer_that_cannot_be_is_refused(value: object) -> None:
    with pytest.raises(PartFileInvalid, match="chamfer_mm"):
        nail_from_json(with_chamfer(value))
