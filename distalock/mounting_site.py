"""`distalock mounting-site`: an image of the nail in, where the screws of the robot's mount go out."""

import argparse
import sys

from distalock.arguments import EXIT_BAD_INPUT
from distalock.locate import EXIT_ACCEPTED, EXIT_REJECTED, LocatedImage, NominalOptions, locate_image, read_parts
from distalock.outputs import require_apart, write_whole
from services.registration.core.mounting_site import MountingSite, site_of_nail
from services.registration.overlay import overlay_png
from services.registration.report import mounting_site_message
from shared.errors import InputError, ReasonCode
from shared.messages.base import encode
from shared.messages.registration import MountingAdvice
from shared.parts.files import read_part_file
from shared.parts.hexapod_file import hexapod_from_json


def run(given: argparse.Namespace) -> int:
    """Run `distalock mounting-site`; returns the exit code: 0 advised, 3 not, 2 bad input."""
    try:
        parts = read_parts(given.ring, given.guide, given.nail)
        hexapod = hexapod_from_json(read_part_file(given.hexapod), str(given.hexapod))
        if given.overlay is not None:
            require_apart(given.overlay, (given.image, given.ring, given.guide, given.nail, given.hexapod))
        found = locate_image(given.image, parts, NominalOptions.of(given))
        site = site_of_nail(found.result, found.calibration, parts, hexapod)
        if given.overlay is not None:
            write_whole(given.overlay, overlay_png(found.pixels, found.calibration, found.result, parts, site))
    except InputError as error:
        print(f"distalock mounting-site: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(encode(_advice(found, site)).decode())
    return EXIT_REJECTED if site is None else EXIT_ACCEPTED


def _advice(found: LocatedImage, site: MountingSite | None) -> MountingAdvice:
    """The reasons are those against image and nail: a missing guide is none."""
    of_guide = (ReasonCode.GUIDE_NOT_FOUND, ReasonCode.GUIDE_AMBIGUOUS)
    reasons = () if site is not None else tuple(r for r in found.message.reasons if r.code not in of_guide)
    return MountingAdvice(
        image=found.message.image,
        reasons=reasons,
        mounting_site=None if site is None else mounting_site_message(site),
    )
