"""Keys and certificates of a hospital's site: its router, its control desk, and each room that shows itself there.

::

    pki/authority/           what signs them; no program reads it
    pki/router/, pki/desk/   of the site's router and of the desk
    pki/ROOM/                carried to that room: its exporter proves by it which room it shows

An authority of their own, which no room's router believes: whoever has taken over the site cannot speak in a room.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from shared.bus.site import DESK, require_room_names
from shared.bus.tls import CERTIFICATE_FILE
from shared.pki.authority import Use
from shared.pki.keystore import AUTHORITY, HERE, ROUTER, Holder, Keystore


def site_holders(rooms: Sequence[str]) -> Mapping[str, Holder]:
    """Whose certificates a site's authority signs; raises `ConfigurationError` for a name that no room can have."""
    require_room_names(rooms)
    return {
        ROUTER: Holder(Use.SERVER, (*HERE, ROUTER, "site")),
        DESK: Holder(Use.CLIENT),
        **{room: Holder(Use.CLIENT) for room in rooms},
    }


def rooms_of(pki_folder: Path) -> tuple[str, ...]:
    """The rooms that have a certificate in a site's folder."""
    others = (ROUTER, DESK, AUTHORITY)
    return tuple(
        sorted(file.parent.name for file in pki_folder.glob(f"*/{CERTIFICATE_FILE}") if file.parent.name not in others)
    )


def site_keystore(pki_folder: Path, new_rooms: Sequence[str] = ()) -> Keystore:
    """The folder of a site's keys and certificates, with those rooms that it has already and new ones."""
    return Keystore(pki_folder, site_holders(tuple(dict.fromkeys((*rooms_of(pki_folder), *new_rooms)))))
