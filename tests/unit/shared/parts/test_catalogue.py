"""The catalogue: every file in its folder is a part that its own reader takes."""

import json

import numpy as np
import pytest

from shared.parts.catalogue import PART_KINDS, PartKind, catalogue, catalogue_entry, catalogue_names, kind_of
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json
from shared.parts.hexapod_file import hexapod_from_json


def part_of(name: str) -> bytes:
    entry = catalogue_entry(name)
    assert entry is not None
    return entry.content


READERS = {"ring": ring_from_json, "guide": guide_from_json, "nail": nail_from_json, "hexapod": hexapod_from_json}


@pytest.mark.parametrize("entry", catalogue(), ids=lambda entry: entry.name)
def test_every_part_can_be_read(entry) -> None:  # type: ignore[no-untyped-def]
    READERS[entry.kind](entry.content, entry.name)
    assert entry.name.startswith(f"{entry.kind}-")


@pytest.mark.parametrize("kind", PART_KINDS)
def test_there_is_a_part_of_every_kind(kind: PartKind) -> None:
    names = catalogue_names(kind)
    assert names
    assert list(names) == sorted(names)
    assert all((entry := catalogue_entry(name)) is not None and entry.kind == kind for name in names)


@pytest.mark.parametrize("name", catalogue_names("nail"))
def test_the_shipped_guide_drills_two_holes_of_every_nail_in_one_move(name: str) -> None:
    nail, guide = nail_from_json(part_of(name)), guide_from_json(part_of("guide-28"))
    places = {hole.id: hole.axis for hole in nail.holes}
    apart = [places[hole.id].point_mm - hole.axis.point_mm for hole in guide.holes]
    assert np.ptp(apart, axis=0) == pytest.approx(np.zeros(3))
    assert all(np.allclose(places[hole.id].direction, hole.axis.direction) for hole in guide.holes)


def test_the_catalogue_has_slots_and_holes_in_several_directions() -> None:
    nails = [nail_from_json(part_of(name)) for name in catalogue_names("nail")]
    assert max(len(nail.holes) for nail in nails) == 4
    assert any(hole.slot_length_mm for nail in nails for hole in nail.holes)


def test_there_is_no_part_of_another_name() -> None:
    assert catalogue_entry("nail-of-wood") is None


@pytest.mark.parametrize("content", [{"schema": "distalock/nail/2"}, {}, ["distalock/nail/1"]])
def test_other_json_is_no_part(content: object) -> None:
    assert kind_of(json.dumps(content).encode()) is None
