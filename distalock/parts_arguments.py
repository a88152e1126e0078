"""Arguments of `distalock parts`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from pathlib import Path

from distalock.arguments import existing_file, named_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    approve = actions.add_parser("approve", help="approve part files, once each, as an administrator")
    approve.add_argument("files", nargs="+", type=existing_file, metavar="FILE", help="part file (JSON)")
    approve.add_argument("--by", required=True, metavar="NAME", help="who approves them")
    approve.add_argument(
        "--length",
        nargs=3,
        metavar=("BALL", "BALL", "MM"),
        help="two balls of a ring or guide and the distance of their centres as measured on the built part",
    )
    hashing = actions.add_parser("hash", help="the hash by which case, robot and record name a part")
    hashing.add_argument("files", nargs="+", type=existing_file, metavar="FILE", help="part file (JSON)")
    hashing.set_defaults(action="hash")
    listing = actions.add_parser("list", help="what may be used: the catalogue, and what was approved")
    for name, action in (("approve", approve), ("list", listing)):
        action.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
        action.set_defaults(action=name)
