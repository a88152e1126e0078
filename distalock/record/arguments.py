"""Arguments of `distalock record`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

from distalock.arguments import named_path


def _verify(parser: argparse.ArgumentParser) -> None:
    del parser


def _backup(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=named_path, metavar="FOLDER", help="a new or empty folder for the backup")


def _restore(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=named_path, metavar="FOLDER", help="what `distalock record backup` wrote")


_ACTIONS: Final[dict[str, tuple[str, Callable[[argparse.ArgumentParser], None]]]] = {
    "verify": ("check the chain of events, and every document that they name", _verify),
    "backup": ("copy record and images into a folder, while the gateway runs", _backup),
    "restore": ("put a backup onto a machine that has no record", _restore),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    for name, (summary, declare) in _ACTIONS.items():
        action = actions.add_parser(name, help=summary, description=summary)
        action.set_defaults(action=name)
        declare(action)
        action.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
        action.add_argument(
            "--database", metavar="URL", help="the record's database; default: as set, then SQLite in the state folder"
        )
        action.add_argument(
            "--images", type=named_path, metavar="FOLDER", help="where imaging stores images; default: in the state"
        )
