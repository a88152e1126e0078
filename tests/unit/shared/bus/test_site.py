"""Names of rooms at a site, and who may do what at its router."""

import pytest

from shared.bus.access_rules import access_control
from shared.bus.site import ANY_SUMMARY, DESK, require_room_names, site_clients, site_table, summary_key
from shared.errors import ConfigurationError

ROOMS = ("or1", "or2")


def granted(client: str) -> set[tuple[str, str, str]]:
    """(flow, kind of message, key) of all that a client may do."""
    rules = access_control(site_table(ROOMS), site_clients(ROOMS))["rules"]
    assert isinstance(rules, list)
    own = [rule for rule in rules if rule["id"].startswith(f"{client} ")]
    return {
        (flow, message, key)
        for rule in own
        for flow in rule["flows"]
        for message in rule["messages"]
        for key in rule["key_exprs"]
    }


def test_a_room_publishes_its_own_summary_and_no_other() -> None:
    puts = {key for flow, message, key in granted("or1") if (flow, message) == ("ingress", "put")}
    assert {key.partition("/@adv")[0] for key in puts} == {summary_key("or1")}


def test_a_desk_sends_no_value_and_asks_for_nothing_but_last_values() -> None:
    sent = {(message, key) for flow, message, key in granted(DESK) if flow == "ingress"}
    assert not {message for message, _ in sent} & {"put", "delete", "reply", "declare_queryable", "liveliness_token"}
    assert {key for message, key in sent if message == "query"} == {f"{ANY_SUMMARY}/@adv/**"}


def test_a_room_receives_nothing_of_other_rooms() -> None:
    received = {key for flow, message, key in granted("or1") if (flow, message) == ("egress", "put")}
    assert received == set()


@pytest.mark.parametrize("name", ["desk", "site", "router", "authority"])
def test_names_that_mean_something_else_are_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"no room can be called '{name}'"):
        require_room_names(["or1", name])


@pytest.mark.parametrize("name", ["", "or/1", "*", "-or", "or 1"])
def test_names_that_are_no_part_of_a_key_are_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match="is no name of a room"):
        require_room_names([name])


def test_two_rooms_of_one_name_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="two rooms have one name: or1, or1"):
        require_room_names(["or1", "or1"])
