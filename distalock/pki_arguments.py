"""Arguments of `distalock pki`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from pathlib import Path
from typing import Final

from distalock.arguments import named_path

_ACTIONS: Final = {
    "init": "make what is missing, and renew what ends within half a year",
    "issue": "a new key and certificate for some services, from the same authority",
    "show": "who has which certificate, and until when",
    "rotate": "a new authority and all certificates: no other is accepted any more",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    for name, summary in _ACTIONS.items():
        action = actions.add_parser(name, help=summary, description=summary)
        action.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
        action.set_defaults(action=name)
        if name == "issue":
            action.add_argument(
                "names", nargs="+", metavar="NAME", help="whose: router, permit, rest, dicom, c_arm, or a service"
            )
        if name == "rotate":
            action.add_argument(
                "--only",
                choices=("bus", "network"),
                help="what the lost key was for: the services' bus, or HTTPS and DICOM",
            )
        if name != "show":
            action.add_argument(
                "--router-host",
                action="append",
                default=[],
                metavar="NAME",
                help="a further name or address under which services reach the router; repeatable",
            )
            action.add_argument(
                "--network-host",
                action="append",
                default=[],
                metavar="NAME",
                help="a further name or address under which browsers and C-arms reach this machine; repeatable",
            )
