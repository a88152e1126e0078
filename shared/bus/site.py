"""Many rooms: what a hospital's site router carries. Each room's exporter publishes a key, a control desk receives all.

There is no key that a desk publishes, asks or answers. A room's own router takes no link from the site: the exporter
connects to both, as a client.
"""

from collections.abc import Sequence
from typing import Final

from shared.bus.access import Exchange, Row
from shared.bus.keys import PREFIX
from shared.errors import ConfigurationError

DESK: Final = "desk"
# What the site router calls itself in keys; no room may be called so.
SITE: Final = "site"
SITE_PORT: Final = 7448
_RESERVED: Final = frozenset((DESK, SITE, "router", "authority"))
_ANY_ROOM: Final = "*"


def summary_key(room: str) -> str:
    """`RoomSummary` of a room, at the site's router; last value kept."""
    return f"{PREFIX}/{room}/{SITE}/summary"


ANY_SUMMARY: Final = summary_key(_ANY_ROOM)


def site_refusals_key() -> str:
    """`BusRefusals` of the site's router."""
    return f"{PREFIX}/{SITE}/router/refusals"


def site_table(rooms: Sequence[str]) -> tuple[Row, ...]:
    """Who may do what at the site's router: a room is who its certificate's common name says."""
    desk, summary = frozenset((DESK,)), "`RoomSummary`"
    return (
        *(Row(summary_key(room), Exchange.RETAINED, room, desk, summary, ANY_SUMMARY) for room in rooms),
        Row(site_refusals_key(), Exchange.STREAM, "router", desk, "`BusRefusals`: what the site's router refused"),
    )


def site_clients(rooms: Sequence[str]) -> tuple[str, ...]:
    """Who has a certificate of the site's authority, apart from its router."""
    return (*rooms, DESK)


def require_room_names(rooms: Sequence[str]) -> None:
    """Refuse names that mean something else at a site, or two of the same; raises `ConfigurationError`."""
    for room in rooms:
        if room in _RESERVED:
            raise ConfigurationError(f"no room can be called '{room}', which names something else at a site")
        if not room or not all(part.isalnum() or part in "._-" for part in room) or not room[0].isalnum():
            raise ConfigurationError(
                f"{room!r} is no name of a room: letters, digits, '.', '_' and '-', a letter first"
            )
    if len(set(rooms)) < len(rooms):
        raise ConfigurationError(f"two rooms have one name: {', '.join(rooms)}")
