"""The access table: what must never be in it, whatever else is."""

from itertools import combinations
from typing import get_args

from shared.bus.access import Exchange, Row, access_table
from shared.bus.key_expressions import includes
from shared.bus.keys import Keys
from shared.messages.robot import Verb

KEYS = Keys("or1")
TABLE = access_table(KEYS)


def row_of(key: str) -> Row:
    (found,) = (row for row in TABLE if row.key == key)
    return found


def test_only_the_gateway_commands_the_robot_and_only_the_robot_answers() -> None:
    commands = [row_of(KEYS.robot_command(verb)) for verb in get_args(Verb)]
    assert {(row.provider, row.consumers, row.exchange) for row in commands} == {
        ("robot", frozenset({"ui_api"}), Exchange.QUERY)
    }


def test_the_robot_hears_plans_and_epochs_of_registration_alone() -> None:
    for key in (KEYS.plan, KEYS.registration_epoch):
        assert row_of(key).provider == "registration"
        assert row_of(key).consumers == frozenset({"robot"})


def test_no_key_has_two_rows() -> None:
    """Nor where an expression covers several: two providers of one key could not be told apart."""
    for one, other in combinations(TABLE, 2):
        assert not includes(one.key, other.key)
        assert not includes(other.key, one.key)


def test_whoever_provides_a_key_has_its_name_in_it() -> None:
    for row in TABLE:
        assert row.provider in row.key.split("/"), row.key


def test_another_room_shares_no_key() -> None:
    assert not {row.key for row in TABLE} & {row.key for row in access_table(Keys("or2"))}
