"""Arguments of `distalock site`, apart from its work."""

import argparse
from pathlib import Path
from typing import Final

from distalock.arguments import named_path
from shared.bus.site import SITE_PORT

_HERE: Final = f"tls/127.0.0.1:{SITE_PORT}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    _init_arguments(_action(actions, "init", "keys of the site: its router's, the desk's, one folder for each room"))
    _router_arguments(_action(actions, "router", "the router to which rooms show themselves, until Ctrl-C"))
    _desk_arguments(_action(actions, "desk", "all rooms at a glance, until Ctrl-C"))


def _action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, summary: str
) -> argparse.ArgumentParser:
    action: argparse.ArgumentParser = actions.add_parser(name, help=summary, description=summary)
    action.add_argument("--state", type=named_path, default=Path("site"), help="state folder of the site (site)")
    action.set_defaults(action=name)
    return action


def _init_arguments(action: argparse.ArgumentParser) -> None:
    action.add_argument(
        "--rooms", nargs="+", default=[], metavar="ROOM", help="rooms that show themselves; adds new ones"
    )
    action.add_argument(
        "--host", action="append", default=[], metavar="NAME", help="name or address of the site's router; repeatable"
    )


def _router_arguments(action: argparse.ArgumentParser) -> None:
    action.add_argument("--listen", default=f"tls/0.0.0.0:{SITE_PORT}", help=f"endpoint (tls/0.0.0.0:{SITE_PORT})")


def _desk_arguments(action: argparse.ArgumentParser) -> None:
    action.add_argument("--router", default=_HERE, help=f"the site's router ({_HERE})")
    action.add_argument(
        "--keys", type=named_path, metavar="FOLDER", help="the desk's keys; default: pki/desk of the state folder"
    )
    action.add_argument("--json", action="store_true", help="a line of JSON for each change instead of a table")
    action.add_argument("--once", action="store_true", help="print what is there and end; 3 when a room needs somebody")
