"""`distalock verify`: K-wires through the guide's holes against the nail's hole axes, from one image or a pair."""

import argparse
import sys
from pathlib import Path

from distalock.locate import (
    EXIT_ACCEPTED,
    EXIT_BAD_INPUT,
    EXIT_REJECTED,
    NominalOptions,
    add_image_options,
    locate_image,
    read_parts,
)
from services.registration.core.localise import Parts
from services.registration.verification import VerifiedImage, verification_message
from shared.errors import InputError
from shared.messages.base import encode
from shared.messages.registration import Verification


def verify_images(images: tuple[Path, ...], parts: Parts, nominal: NominalOptions) -> Verification:
    """Verify the wires in one image file or two of the same set-up; raises `ImageUnreadable`."""
    located = [locate_image(image, parts, nominal) for image in images]
    return verification_message(
        tuple(VerifiedImage(one.pixels, one.calibration, one.result, one.message) for one in located), parts, None
    )


def main(argv: list[str] | None = None) -> int:
    """Run `distalock verify`; returns the exit code: 0 accepted, 3 rejected, 2 bad input."""
    given = _parser().parse_args(argv)
    images = (given.image,) if given.second_image is None else (given.image, given.second_image)
    try:
        parts = read_parts(given.ring, given.guide, given.nail)
        message = verify_images(images, parts, NominalOptions(given.source_to_detector_mm, given.pixel_mm))
    except InputError as error:
        print(f"distalock verify: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(encode(message).decode())
    return EXIT_ACCEPTED if message.verdict == "accepted" else EXIT_REJECTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="distalock verify", description=__doc__)
    parser.add_argument("image", type=Path, help="PNG or TIFF of 8 or 16 bits, or DICOM")
    parser.add_argument("second_image", type=Path, nargs="?", metavar="image2", help="from another direction")
    add_image_options(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
