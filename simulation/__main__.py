"""`python -m simulation`: the virtual operating room alone."""

import argparse
import sys
from pathlib import Path

from shared.arguments import OneLineParser
from shared.errors import ConfigurationError
from simulation.settings import virtual_room_settings
from simulation.virtual_room import run_virtual_or


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the virtual room is started with."""
    parser.add_argument("--host", help="interface to listen on (127.0.0.1)")
    parser.add_argument("--gcs-port", type=int, help="TCP port of the hexapod's controller (50000)")
    parser.add_argument("--control-port", type=int, help="TCP port of the control API (8900)")
    parser.add_argument("--dicom-target", metavar="[TITLE@]HOST:PORT", help="where images are sent")
    parser.add_argument("--seed", type=int, help="seed of the scenario (0)")
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="scenario file, instead of a seed")


def run(given: argparse.Namespace) -> int:
    """Run the room until it is told to end; the exit code is 0 after a clean end and 2 when it cannot start."""
    names = ("host", "gcs_port", "control_port", "dicom_target", "seed", "scenario")
    try:
        settings = virtual_room_settings(**{name: getattr(given, name) for name in names})
    except ConfigurationError as error:
        print(f"virtual-or: {error}", file=sys.stderr)
        return 2
    return run_virtual_or(settings)


def main() -> int:
    """Run it from the command line."""
    parser = OneLineParser(
        prog="python -m simulation", description="The virtual operating room: stands for the hospital's hardware."
    )
    add_arguments(parser)
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
