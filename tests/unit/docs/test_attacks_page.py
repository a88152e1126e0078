"""The page of attacks lists those that are tried."""

from tests.attacks.table import ATTACKS, PAGE, page_with_table


def test_the_page_has_every_attack_as_declared() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == page_with_table(page), "run make attacks and commit docs/attacks.md"


def test_attacks_have_names_of_their_own() -> None:
    assert len({attack.name for attack in ATTACKS}) == len(ATTACKS)
