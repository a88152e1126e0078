"""Arguments of `distalock doctor`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from pathlib import Path

from distalock.arguments import controller_url, named_path, port_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare them."""
    parser.add_argument("--state", type=named_path, default=Path("state"), help="state folder of the installation")
    parser.add_argument("--rest", default="http://127.0.0.1:8000", metavar="URL", help="where the gateway answers")
    parser.add_argument("--dicom-port", type=port_number, default=11112, metavar="PORT", help="port of DICOM (11112)")
    parser.add_argument(
        "--controller", type=controller_url, metavar="URL", help="asked who it is, if no installation runs"
    )
    parser.add_argument("--json", action="store_true", help="the findings as JSON")
