"""Part files: what they may state, and what is refused when they are read."""

import json
from importlib.resources import files
from pathlib import Path

import pytest

from shared.errors import PartFileInvalid
from shared.parts.files import guide_from_json, nail_from_json, read_part_file, ring_from_json

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


def part_of(name: str) -> dict[str, object]:
    return dict(json.loads((files("shared.parts") / "catalogue" / f"{name}.json").read_text()))


def with_hole(**changed: object) -> bytes:
    """The nail with its first hole changed."""
    part = json.loads(TEXT)
    part["holes"][0] |= changed
    return json.dumps(part).encode()


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"direction": [1.0, 0.0, 0.05]}, r"hole 'distal' runs along the nail: 2.9° to its axis, \+x \(at least 30°\)"),
        ({"direction": [0.0, 0.0, 1.1]}, r"the direction of hole 'distal' has length 1.100 \(1 within 0.02\)"),
        ({"direction": [0.0, 0.6, -0.8]}, r"hole 'distal' is directed against drilling: 143.1° to \+z \(limit 100°\)"),
        ({"position_mm": [15.0, 2.6, 0.0]}, r"passes the nail's axis at 2.60 mm \(limit 2.40 in a nail of 10 mm\)"),
        ({"position_mm": [34.0, 0.0, 0.0]}, r"reaches x = 36.6 mm \(limit: the nail's end at 36\)"),
        ({"direction": [0.8, 0.0, 0.6], "position_mm": [28.0, 0.0, 0.0]}, r"reaches x = 37.3 mm"),
        (
            {"slot_length_mm": 5.2},
            r"the slot of hole 'distal' is 5.2 mm long and 5.2 mm wide; leave slot_length_mm out",
        ),
        ({"slot_length_mm": 31.0}, r"slot_length_mm"),
        ({"slot_length_mm": 12.0, "position_mm": [31.0, 0.0, 0.0]}, r"reaches x = 37.0 mm"),
    ],
)
def test_a_hole_that_cannot_be_is_refused_when_the_file_is_read(changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(PartFileInvalid, match=sentence):
        nail_from_json(with_hole(**changed))


def test_holes_that_run_into_one_another_are_refused() -> None:
    across = with_hole(direction=[0.0, 1.0, 0.0], position_mm=[-10.5, 0.0, 0.0])
    with pytest.raises(
        PartFileInvalid, match=r"'distal' and 'proximal' run into one another: .* 4.5 mm \(at least 5.2"
    ):
        nail_from_json(across)
    beside = nail_from_json(with_hole(direction=[0.0, 1.0, 0.0], position_mm=[-9.0, 0.0, 0.0]))
    assert [hole.id for hole in beside.holes] == ["distal", "proximal"]


def test_an_axis_goes_through_the_middle_of_its_way_in_the_nail() -> None:
    leaning = nail_from_json(with_hole(direction=[0.6, 0.0, 0.8], position_mm=[15.0, 0.0, 4.0])).holes[0]
    assert leaning.axis.point_mm == pytest.approx([12.0, 0.0, 0.0])


def test_a_slot_is_read() -> None:
    slot, bore = nail_from_json(with_hole(slot_length_mm=9.2)).holes
    assert (slot.slot_length_mm, bore.slot_length_mm) == (9.2, None)
    assert slot.half_slot_mm == pytest.approx(2.0)
    assert bore.half_slot_mm == 0.0
    assert [slot.half_length_mm, bore.half_length_mm] == pytest.approx([4.6, 2.6])


def test_an_oblique_hole_is_read() -> None:
    oblique = nail_from_json(with_hole(direction=[0.5, 0.0, 0.87], position_mm=[15.0, 0.0, 3.0])).holes[0]
    assert oblique.axis.direction[0] == pytest.approx(0.5, abs=0.01)


def plate(z_mm: float) -> dict[str, float]:
    return {"z_mm": z_mm, "radius_mm": 118.0, "thickness_mm": 3.0}


def balls(count: int) -> list[dict[str, object]]:
    places = [[float(k % 20), float(k // 20), 0.0] for k in range(count)]
    return [{"id": str(k), "position_mm": place, "diameter_mm": 2.0} for k, place in enumerate(places)]


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"balls": balls(20_000), "ball_count": 20_000}, "balls: Tuple should have at most 400 items"),
        ({"balls": balls(15), "ball_count": 15}, r"the ring has 15 balls \(at least 16 must be identified\)"),
        (
            {"plates": [plate(0.0), plate(76.0)]},
            "plates at z = 0, 76",
        ),
        ({"plates": [plate(0.0)]}, "is 76.0 mm from the nearest plate"),
    ],
)
def test_a_ring_that_cannot_be_is_refused_when_the_file_is_read(changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(PartFileInvalid, match=sentence):
        ring_from_json(json.dumps(part_of("ring-120") | changed).encode())


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (
            {"body": [{"centre_mm": [0, 0, 0], "size_mm": [1, 1, 1]}] * 2_000},
            "body: Tuple should have at most 64 items",
        ),
        ({"balls": balls(65), "ball_count": 65}, "balls: Tuple should have at most 64 items"),
    ],
)
def test_a_guide_of_thousands_of_pieces_is_refused(changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(PartFileInvalid, match=sentence):
        guide_from_json(json.dumps(part_of("guide-28") | changed).encode())


def test_a_file_of_many_megabytes_is_not_read_whole(tmp_path: Path) -> None:
    file = tmp_path / "ring.json"
    file.write_bytes(b" " * (4 * 2**20 + 1))
    with pytest.raises(PartFileInvalid, match="more than 4194304 bytes are no part file; name another"):
        read_part_file(file)


def test_a_balls_own_tolerance_goes_before_the_parts() -> None:
    part = part_of("ring-120")
    assert ring_from_json(json.dumps(part).encode()).balls.tolerance_mm is None
    listed = [dict(ball) for ball in json.loads(json.dumps(part["balls"]))]
    listed[3]["tolerance_mm"] = 0.02
    stated = ring_from_json(json.dumps(part | {"balls": listed, "tolerance_mm": 0.1}).encode()).balls.tolerance_mm
    assert stated is not None
    assert stated[:5].tolist() == [0.1, 0.1, 0.1, 0.02, 0.1]


@pytest.mark.parametrize("value", [0.0, -0.1, 1.5, "fine"])
def test_a_tolerance_that_cannot_be_is_refused(value: object) -> None:
    with pytest.raises(PartFileInvalid, match="tolerance_mm"):
        ring_from_json(json.dumps(part_of("ring-120") | {"tolerance_mm": value}).encode())


def test_a_nail_states_tolerances_of_place_and_direction() -> None:
    nail = nail_from_json(json.dumps(json.loads(TEXT) | {"tolerance_mm": 0.05, "tolerance_deg": 0.3}).encode())
    assert (nail.tolerance_mm, nail.tolerance_deg) == (0.05, 0.3)
