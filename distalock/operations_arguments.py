"""Arguments of `distalock operations`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from typing import Final

from distalock.arguments import existing_file, named_path, server_url
from distalock.procedure_arguments import DEFAULT_TOKEN_FILE

STATUSES: Final = ("running", "unknown", "succeeded", "failed", "stopped", "cancelled")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    listing = actions.add_parser("list", help="what takes time or took it, the newest last")
    listing.add_argument("--status", choices=STATUSES, help="only those with this status")
    listing.set_defaults(action="list")
    for name, says in (
        ("follow", "how far one has come, until it has ended"),
        ("cancel", "wait no more for what is computed; what moves the robot is ended by a stop alone"),
    ):
        one = actions.add_parser(name, help=says)
        one.add_argument("operation", metavar="ID", help="the operation, as `list` names it")
        one.set_defaults(action=name)
    for action in actions.choices.values():
        action.add_argument("--rest", type=server_url, required=True, metavar="URL", help="the gateway")
        action.add_argument(
            "--authority", type=existing_file, metavar="FILE", help="whose certificate the gateway has, in PEM (HTTPS)"
        )
        action.add_argument(
            "--token-file",
            type=named_path,
            default=DEFAULT_TOKEN_FILE,
            metavar="FILE",
            help=f"access token, as `up --simulate` keeps it ({DEFAULT_TOKEN_FILE})",
        )
