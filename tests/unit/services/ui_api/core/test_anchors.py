"""Anchors show what the chain alone cannot: that its end was cut off, or all of it was written anew."""

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from services.ui_api.core.anchors import Anchor, check_anchors, next_anchor
from services.ui_api.core.chain import GENESIS_SHA256, ChainIntact

_KEY = "k" * 64


def _sign(content: bytes) -> str:
    return hashlib.sha256(b"secret" + content).hexdigest()


def _has_signed(signature: str, content: bytes) -> bool:
    return signature == _sign(content)


def _hash(number: int) -> str:
    return hashlib.sha256(bytes([number])).hexdigest()


_HASHES = [_hash(n) for n in range(10)]


def _anchors() -> list[Anchor]:
    """Of an empty record, and after 4, 7 and again 7 events."""
    anchors: list[Anchor] = []
    for events in (0, 4, 7, 7):
        head = _HASHES[events - 1] if events else GENESIS_SHA256
        time = f"2026-01-01T0{len(anchors)}:00:00+00:00"
        anchors.append(next_anchor(anchors, ChainIntact(events, head), time, _KEY, _sign))
    return anchors


@pytest.mark.parametrize("events", [7, 8, 10])
def test_a_record_that_only_grew_holds(events: int) -> None:
    assert check_anchors(_anchors(), _HASHES[:events], _KEY, _has_signed) is None


@pytest.mark.parametrize(
    ("changed", "hashes", "finding"),
    [
        (lambda a: a, _HASHES[:6], r"the end was cut off: the record has 6 events, and had 7 at 2026-01-01T02"),
        (lambda a: a, [*_HASHES[:3], "f" * 64, *_HASHES[4:]], r"event 4 is not the one .*anchor 2\)"),
        (lambda a: [a[0], *a[2:]], _HASHES, "anchor 2 does not follow the one before it: one was taken out"),
        (lambda a: [replace(a[0], events=1), *a[1:]], _HASHES, "anchor 1 is not signed by the key kkkkkkkkkkkk"),
        (lambda a: [replace(a[0], gen_time="2020"), *a[1:]], _HASHES, "anchor 1 is not signed"),
        (lambda a: [replace(a[0], tsa="x" * 64), *a[1:]], _HASHES, "anchor 1 is not signed"),
    ],
)
def test_what_was_done_to_record_or_anchors_is_found(
    changed: Callable[[list[Anchor]], list[Anchor]], hashes: list[str], finding: str
) -> None:
    found = check_anchors(changed(_anchors()), hashes, _KEY, _has_signed)
    assert found is not None
    assert re.search(finding, found.message), found.message
