"""Which holes of a nail an image is searched for, by the guide's holes."""

from dataclasses import replace

import numpy as np

from services.registration.core.hole_groups import holes_of_guide
from shared.geometry.lines import Line
from shared.geometry.parts import Hole, NailPart
from tests.unit.services.registration.xray_scene import guide_part, nail_part


def turned_hole(name: str, x_mm: float, turn_deg: float) -> Hole:
    turn = np.radians(turn_deg)
    return Hole(name, Line(np.array([x_mm, 0.0, 0.0]), np.array([0.0, np.sin(turn), np.cos(turn)])), 5.0)


def with_further(*further: Hole) -> NailPart:
    nail = nail_part()
    return replace(nail, holes=(*further, *nail.holes))


def ids(holes: tuple[Hole, ...]) -> list[str]:
    return [hole.id for hole in holes]


def test_holes_across_those_of_the_guide_are_not_localised_but_known() -> None:
    nail = holes_of_guide(
        with_further(turned_hole("anterior", 0.0, 90.0), turned_hole("oblique", -27.0, 30.0)), guide_part()
    )
    assert ids(nail.holes) == ["distal", "proximal"]
    assert ids(nail.other_holes) == ["anterior", "oblique"]
    assert {*ids(nail.all_holes)} == {"anterior", "oblique", "distal", "proximal"}
    assert ids(holes_of_guide(nail, guide_part()).other_holes) == ["anterior", "oblique"]


def test_a_guide_for_the_holes_across_has_these_localised() -> None:
    usual = guide_part()
    guide = replace(usual, holes=(replace(usual.holes[0], id="anterior"),))
    nail = holes_of_guide(with_further(turned_hole("anterior", 0.0, 90.0)), guide)
    assert ids(nail.holes) == ["anterior"]
    assert ids(nail.other_holes) == ["distal", "proximal"]


def test_a_hole_somewhat_askew_is_localised_when_the_guide_has_it() -> None:
    usual = guide_part()
    askew = with_further(turned_hole("third", 0.0, 18.0))
    assert ids(holes_of_guide(askew, usual).holes) == ["distal", "proximal"]
    guide = replace(usual, holes=(*usual.holes, replace(usual.holes[0], id="third")))
    assert ids(holes_of_guide(askew, guide).holes) == ["third", "distal", "proximal"]
