"""`distalock site`: makes the site's keys, runs its router, shows its rooms."""

import argparse
import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from distalock.arguments import EXIT_BAD_INPUT
from distalock.processes import taken_folder
from distalock.site.desk import show_rooms
from shared.bus import router
from shared.bus.settings import BusSettings
from shared.bus.site import DESK
from shared.bus.tls import PKI_FOLDER, TlsFiles
from shared.errors import BusUnavailable, ConfigurationError
from shared.pki.keystore import ROUTER
from shared.pki.site import rooms_of, site_keystore

_OPEN_WITHIN_S: Final = 10.0


def run(given: argparse.Namespace) -> int:
    """Run the action."""
    try:
        match given.action:
            case "init":
                return _init(given.state, given.rooms, given.host)
            case "router":
                return router.main(router_arguments(given.state, given.listen))
            case _:
                files = TlsFiles.in_folder(given.keys or given.state / PKI_FOLDER / DESK)
                settings = BusSettings(given.router, _OPEN_WITHIN_S, files)
                return show_rooms(settings, as_json=given.json, once=given.once)
    except (ConfigurationError, BusUnavailable) as error:
        print(f"distalock site: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT


def router_arguments(state: Path, listen: str) -> list[str]:
    """What the router's program is started with; raises `ConfigurationError` when the site has no room."""
    rooms, files = rooms_of(state / PKI_FOLDER), TlsFiles.in_folder(state / PKI_FOLDER / ROUTER)
    if not rooms:
        raise ConfigurationError(f"no room may show itself at {state}; name some (distalock site init --rooms or1 or2)")
    named = ("--authority", str(files.authority), "--certificate", str(files.certificate), "--key", str(files.key))
    return ["--site", ",".join(rooms), "--listen", listen, *named]


def _init(state: Path, rooms: list[str], hosts: list[str]) -> int:
    folder = state / PKI_FOLDER
    with closing(taken_folder(state / "logs")):
        keystore = site_keystore(folder, rooms)
        new = keystore.ensure(datetime.now(UTC), hosts)
    for room in rooms_of(folder):
        print(f"{room:13}{'new' if room in new else 'as before'}: carry {folder / room} to that room, and nothing else")
    print(f"{DESK:13}{folder / DESK}: for `distalock site desk --keys`, on any machine")
    if new:
        print("Start the site's router again: it knows the rooms that it started with.")
    return 0
