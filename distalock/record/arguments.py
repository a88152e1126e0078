"""Arguments of `distalock record`, apart from its work: bad ones are answered before anything heavy is imported."""

import argparse
from typing import Final

from distalock.arguments import Declares, add_actions, add_record_arguments, existing_file, named_path, whole_number
from services.ui_api.core.retention import CLOSED_DAYS, FRAMES_DAYS


def _verify(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--anchors", type=existing_file, metavar="FILE", help="countersigned heads: shows a cut end")
    parser.add_argument("--public-key", type=existing_file, metavar="FILE", help="of the key that the anchors are by")


def _backup(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=named_path, metavar="FOLDER", help="a new or empty folder for the backup")


def _restore(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=named_path, metavar="FOLDER", help="what `distalock record backup` wrote")


def _anchor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--anchors",
        type=named_path,
        required=True,
        metavar="FILE",
        help="where anchors are kept, apart from the record",
    )
    parser.add_argument(
        "--key",
        type=named_path,
        required=True,
        metavar="FILE",
        help="private key that signs; made when it is not there",
    )


def _prune(parser: argparse.ArgumentParser) -> None:
    for name, default, what in (
        ("closed", CLOSED_DAYS, "cases that have been closed for so long go, with documents and images"),
        ("frames", FRAMES_DAYS, "frames of fluoroscopy without a measurement, and images of no case, go after so long"),
    ):
        parser.add_argument(
            f"--{name}-days",
            type=whole_number("a number of days", 1, 36525),
            default=default,
            metavar="DAYS",
            help=f"{what} ({default})",
        )
    parser.add_argument("--apply", action="store_true", help="do it; without, only what would go is listed")
    parser.add_argument("--by", metavar="NAME", help="who decides it; goes on record; needed with --apply")


def _hand_over(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("case", metavar="CASE", help="id of the case, as GET /cases lists it")
    parser.add_argument("--out", type=named_path, required=True, metavar="FOLDER", help="a new or empty folder")


_ACTIONS: Final[dict[str, tuple[str, Declares]]] = {
    "verify": ("check the chain of events, and every document that they name", _verify),
    "backup": ("copy record and images into a folder, while the gateway runs", _backup),
    "anchor": ("countersign the chain's head with a key of your own, and its time", _anchor),
    "export": ("one case as a folder that a stranger can read and check", _hand_over),
    "anonymise": ("the same without what identifies people (DICOM PS3.15 Annex E)", _hand_over),
    "prune": ("remove by rule what has been kept long enough; the chain stays verifiable", _prune),
    "restore": ("put a backup onto a machine that has no record", _restore),
}


def _images(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--images", type=named_path, metavar="FOLDER", help="where imaging stores images; default: in the state"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    add_actions(parser, _ACTIONS, (add_record_arguments, _images))
