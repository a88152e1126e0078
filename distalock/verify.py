"""`distalock verify`: K-wires through the guide's holes against the nail's hole axes, from one image or a pair."""

import argparse
import sys
from pathlib import Path

from distalock.arguments import EXIT_BAD_INPUT
from distalock.image_files import read_image_file, require_different
from distalock.locate import EXIT_ACCEPTED, EXIT_REJECTED, NominalOptions, localised_image, located, read_parts
from services.registration.core.localise import Parts
from services.registration.core.wires.verify import verify_guide_alone
from services.registration.core.wires.verify import verify_images as verify_wires
from services.registration.report import verification_message
from shared.equipment import USUAL_WIRE_DIAMETER_MM
from shared.errors import InputError
from shared.messages.base import encode
from shared.messages.registration import Verification

MOST_IMAGES = 2


def verify_images(
    images: tuple[Path, ...],
    parts: Parts,
    nominal: NominalOptions,
    before: tuple[Path, ...] = (),
    wire_diameter_mm: float | None = USUAL_WIRE_DIAMETER_MM,
) -> Verification:
    """Verify the wires in one image file or two of the same set-up.

    Parameters
    ----------
    before
        Images of the same set-up from before the wires were inserted.
    wire_diameter_mm
        Diameter of the wires in use; None to verify the guide alone.

    Raises
    ------
    InputError
        When a file is not an image that can be measured, or one image is given twice.
    """
    files = tuple(read_image_file(image) for image in (*before, *images))
    require_different(files)
    found = tuple(located(file, parts, nominal) for file in files)
    given = tuple(localised_image(file.path.name, one) for file, one in zip(files, found, strict=True))
    these, earlier = given[len(before) :], given[: len(before)]
    hashes = tuple(one.message.image.sha256 for one in found[len(before) :])
    if wire_diameter_mm is None:
        message = verification_message(hashes, verify_guide_alone(these, earlier, parts), "guide")
    else:
        message = verification_message(hashes, verify_wires(these, earlier, parts, wire_diameter_mm))
    notes = tuple(dict.fromkeys(note for one in found for note in one.message.notes))
    return message.model_copy(update={"notes": notes})


def _require_few(images: tuple[Path, ...]) -> None:
    if len(images) > MOST_IMAGES:
        raise InputError(
            f"{len(images)} images with wires were given (limit {MOST_IMAGES}: a lateral and an oblique one); leave "
            "the others out, or give those from before the wires after --before"
        )


def run(given: argparse.Namespace) -> int:
    """Run `distalock verify`; returns the exit code: 0 accepted, 3 rejected, 2 bad input."""
    images = tuple(given.images)
    try:
        _require_few(images)
        parts = read_parts(given.ring, given.guide, given.nail, given.drill_mm)
        nominal = NominalOptions.of(given)
        message = verify_images(
            images, parts, nominal, tuple(given.before), None if given.guide_alone else given.wire_mm
        )
    except InputError as error:
        print(f"distalock verify: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(encode(message).decode())
    return EXIT_ACCEPTED if message.verdict == "accepted" else EXIT_REJECTED
