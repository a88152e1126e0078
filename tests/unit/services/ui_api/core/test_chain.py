"""The hash chain of the log."""

from dataclasses import replace

import pytest

from services.ui_api.core.chain import GENESIS_SHA256, ChainBroken, ChainEntry, ChainIntact, check_chain, entry_sha256


def _chain(length: int) -> list[ChainEntry]:
    entries: list[ChainEntry] = []
    previous = GENESIS_SHA256
    for sequence in range(1, length + 1):
        entry = ChainEntry(sequence, 7 * sequence, "case-1", "Dr A", "", "step_recorded", "{}", previous, "")
        entries.append(replace(entry, sha256=entry_sha256(entry)))
        previous = entries[-1].sha256
    return entries


def test_an_untouched_chain_holds() -> None:
    entries = _chain(5)
    assert check_chain(entries) == ChainIntact(5, entries[-1].sha256)
    assert check_chain([]) == ChainIntact(0, GENESIS_SHA256)


@pytest.mark.requirement("GW-06")
@pytest.mark.parametrize(
    "change",
    [
        {"at_ns": 1},
        {"case_id": None},
        {"who": "Dr B"},
        {"why": "because"},
        {"kind": "plan_made"},
        {"data_json": '{"a":1}'},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_changed_entry_is_found(change: dict[str, object]) -> None:
    entries = _chain(5)
    entries[2] = replace(entries[2], **change)  # type: ignore[arg-type]  # one field of the right type each
    verdict = check_chain(entries)
    assert isinstance(verdict, ChainBroken)
    assert verdict.sequence == 3
    assert "was changed" in verdict.message


def test_a_changed_entry_with_a_new_hash_breaks_the_one_after_it() -> None:
    entries = _chain(5)
    forged = replace(entries[2], who="Dr B")
    entries[2] = replace(forged, sha256=entry_sha256(forged))
    assert check_chain(entries) == ChainBroken(
        4, "event 4 does not follow the event before it: its previous hash differs"
    )


def test_a_removed_entry_is_found() -> None:
    entries = _chain(5)
    assert check_chain(entries[:1] + entries[2:]) == ChainBroken(2, "event 2 is missing: the log goes on with event 3")


def test_the_hash_covers_where_a_field_ends() -> None:
    entry = _chain(1)[0]
    assert entry_sha256(replace(entry, who="ab", why="c")) != entry_sha256(replace(entry, who="a", why="bc"))
