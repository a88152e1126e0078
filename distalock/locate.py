"""`distalock locate`: one image or several and three part files in, both hole axes out, as one JSON object."""

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distalock.arguments import EXIT_BAD_INPUT
from distalock.image_files import ImageFile, images_in, read_image_file, require_different
from distalock.outputs import require_apart, write_whole
from services.imaging.core.calibration import calibrate_image
from services.imaging.core.nominal import NominalGeometry
from services.imaging.devices.nominal_values import ImageNominal, StatedValues, nominal_of_image
from services.imaging.devices.received_image import Acquisition, Polarity
from services.registration.core.fusion import ImageResult, fuse_localisations
from services.registration.core.localise import LocalisationResult, Parts, localise
from services.registration.frames import parts_from_json
from services.registration.overlay import overlay_png
from services.registration.report import (
    Localiser,
    message_of_several,
    timed_localisation,
)
from shared.equipment import USUAL_DRILL_DIAMETER_MM
from shared.errors import Accepted, ImageUnreadable, InputError, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.messages.base import encode
from shared.messages.registration import Localisation, Method, UnreadableImage
from shared.parts.files import read_part_file

EXIT_ACCEPTED, EXIT_REJECTED = 0, 3


@dataclass(frozen=True, slots=True)
class NominalOptions:
    """What a person states of C-arm and images; None where the image or the default decides."""

    source_to_detector_mm: float | None = None
    pixel_mm: float | None = None
    focal_spot_mm: float | None = None
    polarity: Polarity = Polarity.AS_TAGGED

    @staticmethod
    def of(given: argparse.Namespace) -> "NominalOptions":
        """The options of `add_c_arm_arguments`."""
        polarity = Polarity.INVERTED if given.invert else Polarity.AS_TAGGED
        return NominalOptions(given.source_to_detector_mm, given.pixel_mm, given.focal_spot_mm, polarity)

    def of_image(self, image: Acquisition) -> ImageNominal:
        """Option before DICOM header before default; raises `ImageUnreadable` for a header that cannot be right."""
        stated = StatedValues(self.source_to_detector_mm, self.pixel_mm, self.focal_spot_mm)
        return nominal_of_image(stated, image, NominalGeometry())

    def geometry(self, image: Acquisition) -> NominalGeometry:
        """The nominal values alone."""
        return self.of_image(image).geometry

    def pixels(self, read: NDArray[np.float32]) -> NDArray[np.float32]:
        """Grey values of a file as read, shape (rows, columns), made darker where it is denser."""
        return self.polarity.normalised(read)


@dataclass(frozen=True, slots=True, eq=False)
class LocatedImage:
    """Everything one image gave, or several together: then image and calibration are those of the newest one used.

    Attributes
    ----------
    pixels
        The image as received, darker is denser, shape (rows, columns).
    calibration
        None when the ring was not found.
    message
        What `locate` prints.
    """

    pixels: NDArray[np.float32]
    calibration: CArmCalibration | None
    result: LocalisationResult
    message: Localisation


def read_parts(ring: Path, guide: Path, nail: Path, drill_diameter_mm: float = USUAL_DRILL_DIAMETER_MM) -> Parts:
    """Read three part files; raises `PartFileInvalid` with one sentence."""
    return parts_from_json(
        read_part_file(ring),
        read_part_file(guide),
        read_part_file(nail),
        drill_diameter_mm,
        (str(ring), str(guide), str(nail)),
    )


def locate_image(
    image: Path,
    parts: Parts,
    nominal: NominalOptions = NominalOptions(),
    method: Method = "model",
) -> LocatedImage:
    """Localise the nail's hole axes in one image file (PNG, TIFF or DICOM).

    Raises
    ------
    ImageUnreadable
        When the file is not an image that can be measured.
    """
    return located(read_image_file(image), parts, nominal, method)


def located(image: ImageFile, parts: Parts, nominal: NominalOptions, method: Method = "model") -> LocatedImage:
    """Localise the nail's hole axes in one image that has been read."""
    started = time.perf_counter()
    pixels = nominal.pixels(image.content.pixels)
    try:
        of_image = nominal.of_image(image.content.acquisition)
    except ImageUnreadable as error:
        raise ImageUnreadable(f"{image.path}: {error}") from None
    outcome = _calibrated(pixels, parts, of_image.geometry, method)
    ring_ms = 1e3 * (time.perf_counter() - started)
    result, message = timed_localisation(pixels, outcome, parts, image.sha256, ring_ms, (method, _localiser(method)))
    calibration = outcome.value if isinstance(outcome, Accepted) else None
    return LocatedImage(pixels, calibration, result, message.model_copy(update={"notes": of_image.notes}))


def _calibrated(
    pixels: NDArray[np.float32], parts: Parts, nominal: NominalGeometry, method: Method
) -> Accepted[CArmCalibration] | Rejected:
    """Calibrate from the ring; the fronto-parallel method calibrates once more by its own means."""
    ours = calibrate_image(pixels, parts.ring, nominal)
    if isinstance(ours, Rejected) or method == "model":
        return ours
    # imported only when asked for: the comparison method is no part of the product's start-up
    from baselines.fronto_parallel.calibration import calibrate_by_plates

    return calibrate_by_plates(pixels, ours.value, parts.ring)


def _localiser(method: Method) -> Localiser:
    if method == "model":
        return localise
    from baselines.fronto_parallel.localise import localise_fronto_parallel

    return localise_fronto_parallel


def locate_images(
    images: tuple[Path, ...], parts: Parts, nominal: NominalOptions, method: Method = "model"
) -> LocatedImage:
    """Localise in one image file, or in several of the same set-up, in the order in which they were taken.

    Raises
    ------
    InputError
        When a file is not an image that can be measured, or one image is given twice.
    """
    files = tuple(read_image_file(image) for image in images)
    require_different(files)
    found = tuple(located(file, parts, nominal, method) for file in files)
    if len(found) == 1:
        return found[0]
    names = tuple(image.name for image in images)
    fused = fuse_localisations(tuple(localised_image(*one) for one in zip(names, found, strict=True)), parts)
    message = message_of_several(fused, tuple(one.message for one in found), names)
    shown = found[-1 if fused is None else fused.shown]
    return LocatedImage(shown.pixels, shown.calibration, shown.result if fused is None else fused.result, message)


def image_paths(places: Iterable[Path]) -> Iterator[Path]:
    """Image files as they were named, and those of folders, sorted by name.

    Raises
    ------
    InputError
        When a folder holds no image, or cannot be read.
    """
    for place in places:
        if not place.is_dir():
            yield place
            continue
        files = images_in(place)
        if not files:
            raise InputError(f"{place}: 0 images (at least 1, PNG, TIFF or DICOM); name the folder of the images")
        yield from files


def _run_each(given: argparse.Namespace) -> int:
    """Localise each image by itself, one JSON line each; a file that is no image has a line of its own."""
    try:
        parts = read_parts(given.ring, given.guide, given.nail, given.drill_mm)
        images = tuple(image_paths(given.images))
    except InputError as error:
        print(f"distalock locate: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    nominal, method, codes = NominalOptions.of(given), given.method, set()
    for image in images:
        message: Localisation | UnreadableImage
        try:
            found = locate_image(image, parts, nominal, method).message
            message = found.model_copy(update={"image_file": str(image)})
            codes.add(EXIT_ACCEPTED if found.verdict == "accepted" else EXIT_REJECTED)
        except ImageUnreadable as error:
            message = UnreadableImage(image_file=str(image), error=str(error))
            codes.add(EXIT_BAD_INPUT)
        print(encode(message).decode(), flush=True)
    return next(code for code in (EXIT_BAD_INPUT, EXIT_REJECTED, EXIT_ACCEPTED) if code in codes)


def localised_image(name: str, found: LocatedImage) -> ImageResult:
    """What the core needs of an image; sentences call it by `name`."""
    return ImageResult(name, found.pixels, found.calibration, found.result)


def run(given: argparse.Namespace) -> int:
    """Run `distalock locate`; returns the exit code: 0 accepted, 3 rejected, 2 bad input."""
    if given.each:
        return _run_each(given)
    images, overlay = tuple(given.images), given.overlay
    try:
        parts = read_parts(given.ring, given.guide, given.nail, given.drill_mm)
        if overlay is not None:
            require_apart(overlay, (*images, given.ring, given.guide, given.nail))
        nominal = NominalOptions.of(given)
        found = locate_images(images, parts, nominal, given.method)
        if overlay is not None:
            drawn = overlay_png(found.pixels, found.calibration, found.result, parts)
            write_whole(overlay, drawn)
    except InputError as error:
        print(f"distalock locate: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if len(images) > 1:
        print(
            f"distalock locate: {len(images)} images are taken as one set-up; --each localises each by itself",
            file=sys.stderr,
        )
    print(encode(found.message).decode())
    return EXIT_ACCEPTED if found.message.verdict == "accepted" else EXIT_REJECTED
