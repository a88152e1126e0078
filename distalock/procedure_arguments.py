"""Arguments of `distalock procedure`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from pathlib import Path
from typing import Final

from distalock.arguments import existing_file, named_path, server_url, whole_number

DEFAULT_TOKEN_FILE: Final = Path("state") / "demo-token"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare them."""
    parser.add_argument("--rest", type=server_url, required=True, metavar="URL", help="the gateway")
    parser.add_argument("--room", type=server_url, required=True, metavar="URL", help="control API of the virtual room")
    parser.add_argument(
        "--authority", type=existing_file, metavar="FILE", help="whose certificate the gateway has, in PEM (HTTPS)"
    )
    parser.add_argument(
        "--token-file",
        type=named_path,
        default=DEFAULT_TOKEN_FILE,
        metavar="FILE",
        help=f"access token of a surgeon, as `up --simulate` keeps it ({DEFAULT_TOKEN_FILE})",
    )
    parser.add_argument(
        "--wait-s",
        type=whole_number("a time in seconds", 0, 3600),
        default=60,
        metavar="S",
        help="how long to wait until all services are there (60)",
    )
