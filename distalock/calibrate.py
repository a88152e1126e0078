"""Arguments of `distalock calibrate ring|guide IMAGES...`; the work is done in `part_calibration`."""

import argparse
from typing import Final

from distalock.arguments import PART_HELP, add_c_arm_arguments, named_path, part_file, writable_file

LEAST_IMAGES: Final = 6
MOST_IMAGES: Final = 40


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the two subcommands."""
    chosen = parser.add_subparsers(required=True, metavar="WHAT", dest="part")
    for part, needed in (("ring", ("ring",)), ("guide", ("guide", "ring"))):
        sub = chosen.add_parser(part, help=f"where the balls of a built {part} are")
        sub.add_argument(
            "images", type=named_path, nargs="+", metavar="IMAGE", help=f"{LEAST_IMAGES} to {MOST_IMAGES}, or folders"
        )
        for name in needed:
            sub.add_argument(f"--{name}", type=part_file, required=True, metavar="PART", help=PART_HELP.format(name))
        sub.add_argument("--out", type=writable_file, metavar="MEASURED.json", help="write the measured part file")
        add_c_arm_arguments(sub)
