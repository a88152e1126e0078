"""`python -m simulation`: the virtual operating room alone."""

import argparse
import sys

from shared.arguments import EXIT_BAD_INPUT, OneLineParser
from shared.errors import ConfigurationError
from simulation.settings import add_room_arguments, virtual_room_settings


def run(given: argparse.Namespace) -> int:
    """Run the room until it is asked to end; the exit code is 0 after a clean end and 2 when it cannot start."""
    try:
        settings = virtual_room_settings(**vars(given))
    except ConfigurationError as error:
        print(f"virtual-or: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    from simulation.virtual_room import run_virtual_or

    return run_virtual_or(settings)


def main() -> int:
    """Run it from the command line."""
    parser = OneLineParser(
        prog="python -m simulation", description="The virtual operating room: stands for the hospital's hardware."
    )
    add_room_arguments(parser)
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
