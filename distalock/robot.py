"""`distalock robot ...`: what can be asked about the robot without a running installation."""

import argparse
from typing import Final

from distalock.arguments import (
    PART_HELP,
    add_c_arm_arguments,
    length_mm,
    named_path,
    part_file,
    whole_number,
    writable_file,
)
from shared.parts.catalogue import DEFAULT_HEXAPOD

DEFAULT_EXTENSION_MM: Final = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the subcommands."""
    chosen = parser.add_subparsers(required=True, metavar="WHAT")
    workspace = chosen.add_parser("workspace", help="draw where the guide can be brought and how far turned")
    add_hexapod_arguments(workspace)
    workspace.add_argument(
        "--out", type=writable_file, default="workspace.png", metavar="OUT.png", help="workspace.png"
    )
    workspace.set_defaults(run_robot=_workspace)

    poses = chosen.add_parser("calibration-poses", help="poses to take the images for calibrate-guide in")
    add_hexapod_arguments(poses)
    poses.add_argument(
        "--count",
        type=whole_number("a number of images", 5, 50),
        default=9,
        metavar="N",
        help="images, the check included (9)",
    )
    poses.set_defaults(run_robot=_poses)
    calibrate = chosen.add_parser("calibrate-guide", help="how the head holds the guide, from images in several poses")
    add_hexapod_arguments(calibrate)
    add_c_arm_arguments(calibrate)
    calibrate.add_argument(
        "poses", type=named_path, metavar="POSES.json", help="images with poses, the last for the check"
    )
    for name in ("ring", "guide"):
        calibrate.add_argument(f"--{name}", type=part_file, required=True, metavar="PART", help=PART_HELP.format(name))
    calibrate.add_argument(
        "--out", type=writable_file, metavar="HEXAPOD.json", help="write the hexapod file with its head as found"
    )
    calibrate.set_defaults(run_robot=_calibrate)


def add_hexapod_arguments(parser: argparse.ArgumentParser) -> None:
    """Which robot, and how its head is set."""
    parser.add_argument(
        "--hexapod", type=part_file, default=DEFAULT_HEXAPOD, metavar="PART", help=PART_HELP.format("hexapod")
    )
    parser.add_argument(
        "--head-extension-mm",
        type=length_mm(0.0, 500.0),
        default=DEFAULT_EXTENSION_MM,
        metavar="MM",
        help=f"what the head's scale says ({DEFAULT_EXTENSION_MM:g})",
    )


def _poses(given: argparse.Namespace) -> int:
    from distalock.robot_calibration import print_poses

    return print_poses(given)


def _calibrate(given: argparse.Namespace) -> int:
    from distalock.robot_calibration import run

    return run(given)


def _workspace(given: argparse.Namespace) -> int:
    from distalock.robot_workspace import run

    return run(given)
