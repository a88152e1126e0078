"""What the page of threats calls a test exists."""

import re
from pathlib import Path

import pytest

from tests.attacks.table import ATTACKS

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "threats.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if re.match(r"\| [STRIDE](, [STRIDE])* \|", line)]


def test_every_attack_that_is_named_is_tried() -> None:
    named = set(re.findall(r"attack `([^`]+)`", PAGE))
    assert len(named) > 40
    assert named <= {attack.name for attack in ATTACKS}


@pytest.mark.parametrize("file", sorted(set(re.findall(r"`(tests/[^`]+)`", PAGE))))
def test_every_test_that_is_named_is_there(file: str) -> None:
    assert (ROOT / file).is_file()


def test_a_threat_has_a_test_or_the_page_says_what_is_left() -> None:
    assert len(ROWS) > 30
    for row in ROWS:
        *_, test, left, _ = (cell.strip() for cell in row.split("|"))
        assert test or left, row
