"""`docs/keys.md` is printed from the access table, and the table has every key that there is."""

from pathlib import Path

from shared.bus.access import CLIENTS, access_table
from shared.bus.key_expressions import includes
from shared.bus.keys import Keys
from tools.keys_page import keys_page

_PAGE = Path(__file__).parents[3] / "docs" / "keys.md"


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == keys_page(), "run: make generated"


def test_every_service_has_a_row_of_its_own() -> None:
    rows = [line.split(" | ")[0] for line in keys_page().split("## Service by service")[1].splitlines()]
    assert [f"| {service}" for service in CLIENTS] == [row for row in rows if row.removeprefix("| ") in CLIENTS]


def test_every_key_is_in_the_table() -> None:
    keys = Keys("or1")
    named = {getattr(keys, name) for name, value in vars(Keys).items() if isinstance(value, property)}
    listed = {row.key for row in access_table(keys)}
    assert len(named) > 10
    assert named <= listed
    assert any(includes(row.key, keys.frame_by_hash("abc")) for row in access_table(keys))
