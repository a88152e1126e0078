"""`distalock robot ...`: what can be asked about the robot without a running installation."""

import argparse
from pathlib import Path
from typing import Final

from distalock.arguments import existing_file, positive_mm
from shared.parts.hexapod_file import DEFAULT_HEXAPOD

DEFAULT_EXTENSION_MM: Final = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the subcommands."""
    chosen = parser.add_subparsers(required=True, metavar="WHAT")
    workspace = chosen.add_parser("workspace", help="draw where the guide can be brought and how far turned")
    add_hexapod_arguments(workspace)
    workspace.add_argument("--out", type=Path, default=Path("workspace.png"), metavar="OUT.png", help="workspace.png")
    workspace.set_defaults(run_robot=_workspace)


def add_hexapod_arguments(parser: argparse.ArgumentParser) -> None:
    """Which robot, and how its head is set."""
    parser.add_argument(
        "--hexapod", type=existing_file, default=DEFAULT_HEXAPOD, metavar="FILE", help="hexapod file (JSON)"
    )
    parser.add_argument(
        "--head-extension-mm",
        type=positive_mm,
        default=DEFAULT_EXTENSION_MM,
        metavar="MM",
        help=f"what the head's scale says ({DEFAULT_EXTENSION_MM:g})",
    )


def _workspace(given: argparse.Namespace) -> int:
    from distalock.robot_workspace import run

    return run(given)
