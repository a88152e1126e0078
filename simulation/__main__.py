"""`python -m simulation`: the virtual operating room alone."""

import argparse
import sys
from pathlib import Path

from shared.errors import ConfigurationError
from simulation.settings import virtual_room_settings
from simulation.virtual_room import run_virtual_or


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="virtual-or", description="The virtual operating room: stands for hardware.")
    parser.add_argument("--host", help="interface to listen on (127.0.0.1)")
    parser.add_argument("--gcs-port", type=int, help="TCP port of the hexapod's controller (50000)")
    parser.add_argument("--control-port", type=int, help="TCP port of the control API (8900)")
    parser.add_argument("--dicom-target", metavar="[TITLE@]HOST:PORT", help="where images are sent")
    parser.add_argument("--seed", type=int, help="seed of the scenario (0)")
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="scenario file, instead of a seed")
    return parser.parse_args()


def main() -> int:
    """Run it; the exit code is 0 after a clean end and 2 when it cannot start."""
    try:
        settings = virtual_room_settings(**vars(_arguments()))
    except ConfigurationError as error:
        print(f"virtual-or: {error}", file=sys.stderr)
        return 2
    return run_virtual_or(settings)


if __name__ == "__main__":
    sys.exit(main())
