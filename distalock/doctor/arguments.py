"""Arguments of `distalock doctor`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from pathlib import Path

from distalock.arguments import add_port_arguments, controller_url, named_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare them."""
    parser.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
    parser.add_argument("--https", action="store_true", help="the gateway speaks HTTPS")
    add_port_arguments(parser, ("router", "rest", "dicom"))
    parser.add_argument(
        "--controller", type=controller_url, metavar="URL", help="asked who it is, if no installation runs"
    )
    parser.add_argument("--json", action="store_true", help="the findings as JSON")
