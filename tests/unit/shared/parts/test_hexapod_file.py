"""The hexapod file: what is read, and what is refused."""

import json
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from shared.errors import PartFileInvalid
from shared.geometry.frames import Guide
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import DEFAULT_HEXAPOD, default_hexapod, hexapod_from_json, hexapod_json_with_head

Document = dict[str, object]


def shipped() -> Document:
    return cast("Document", json.loads(DEFAULT_HEXAPOD.read_bytes()))


def read(document: Document) -> None:
    hexapod_from_json(json.dumps(document).encode(), "h.json")


def test_the_shipped_robot_has_the_published_figures() -> None:
    hexapod = default_hexapod()
    np.testing.assert_allclose(np.linalg.norm(hexapod.base_joints_mm, axis=1), 22.0, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(hexapod.top_joints_mm, axis=1), 18.0, atol=1e-4)
    assert (hexapod.leg_length_mm.minimum, hexapod.leg_length_mm.maximum) == (37.0, 53.0)
    assert (hexapod.speed_limits.translation_mm_per_s, hexapod.speed_limits.rotation_deg_per_s) == (2.0, 2.0)
    assert (hexapod.stiffness.translation_n_per_mm, hexapod.stiffness.rotation_nm_per_deg) == (200.0, 5.0)
    assert len(hexapod.sha256) == 64


def _unknown_key(d: Document) -> None:
    d["colour"] = "red"


def _five_legs(d: Document) -> None:
    d["legs"] = cast("list[object]", d["legs"])[:5]


def _repeated_leg(d: Document) -> None:
    legs = cast("list[Document]", d["legs"])
    legs[1]["id"] = legs[0]["id"]


def _other_order(d: Document) -> None:
    d["rotation_order"] = "Rz(W)*Ry(V)*Rx(U)"


def _reversed_range(d: Document) -> None:
    d["leg_length_mm"] = {"minimum": 53.0, "maximum": 37.0}


def _not_a_rotation(d: Document) -> None:
    cast("Document", d["head"])["top_from_guide_rotation"] = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]


def _home_out_of_reach(d: Document) -> None:
    cast("Document", d["home_pose"])["z_mm"] = 20.0


def _inches(d: Document) -> None:
    d["units"] = "inch"


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (_unknown_key, r"h\.json: colour: Extra inputs are not permitted"),
        (_five_legs, r"h\.json: legs: .*at least 6 items"),
        (_repeated_leg, r"h\.json: .*leg id '1' appears more than once"),
        (_other_order, r"h\.json: rotation_order: Input should be 'Rx\(U\)\*Ry\(V\)\*Rz\(W\)'"),
        (_reversed_range, r"h\.json: leg_length_mm: .*the minimum 53 is not below the maximum 37"),
        (_not_a_rotation, r"h\.json: head\.top_from_guide_rotation: .*not right-handed orthonormal"),
        (_home_out_of_reach, r"h\.json: home_pose is out of reach: leg 1 would be"),
        (_inches, r"h\.json: units: Input should be 'mm'"),
    ],
)
def test_broken_files_are_refused_with_a_sentence(spoil: Callable[[Document], None], sentence: str) -> None:
    document = shipped()
    spoil(document)
    with pytest.raises(PartFileInvalid, match=sentence):
        read(document)


def test_the_hash_is_of_what_a_file_says_not_of_how_it_is_written() -> None:
    content = DEFAULT_HEXAPOD.read_bytes()
    parsed = json.loads(content)
    rewritten = dict(reversed(parsed.items())) | {"zero_height_mm": float(parsed["zero_height_mm"])}
    assert hexapod_from_json(json.dumps(rewritten).encode()).sha256 == default_hexapod().sha256
    taller = parsed | {"zero_height_mm": parsed["zero_height_mm"] + 0.001}
    assert hexapod_from_json(json.dumps(taller).encode()).sha256 != default_hexapod().sha256


def test_another_head_is_written_and_read_again() -> None:
    hexapod = default_hexapod()
    off: Transform[Guide, Guide] = Transform.from_rotvec([0.01, -0.02, 0.005], [0.3, -0.2, 0.5])
    found = hexapod.top_from_guide(65.0) @ off
    written = hexapod_from_json(hexapod_json_with_head(DEFAULT_HEXAPOD.read_bytes(), found.matrix, 65.0))
    np.testing.assert_allclose(written.top_from_guide(65.0).matrix, found.matrix, atol=1e-12)
    np.testing.assert_allclose(written.top_from_guide(45.0).translation_mm, found.translation_mm - [20.0, 0.0, 0.0])
