"""An image with wires, and the nail in it once the wires in front of its holes are known."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion.localise import LocalisedImage, usable_evidence
from services.registration.core.guide.locate import GuideFit
from services.registration.core.localise import Parts, unmirrored
from services.registration.core.wires.nail_behind import localise_behind_wires
from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.geometry.lines import angle_between_rad, unit

# Of the guide's axes against the ray: holes are found up to 14 degrees, and the guide may stand several off.
LARGEST_TILT_DEG = 25.0
_TO_NAIL_MM = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class WiredImage:
    """One image with wires.

    Attributes
    ----------
    pixels
        As received, darker is denser, shape (rows, columns).
    found
        What was found in it.
    """

    pixels: NDArray[np.float32]
    found: LocalisedImage


def beside_wires(image: WiredImage, parts: Parts) -> WiredImage:
    """The image with the nail as it is found once the wires in front of it are known.

    An image whose guide was not found stays as it is, and so does one that looks at the holes from aside, where they
    cannot be open, or that shows no wire in front of them.
    """
    found, calibration = image.found, image.found.calibration
    if calibration is None or found.result is None or found.result.guide is None:
        return image
    if tilt_of_guide_deg(found.result.guide, parts) > LARGEST_TILT_DEG:
        return image
    known = found.result.nail if usable_evidence(found, parts) is not None else None
    upright = unmirrored(image.pixels, calibration)
    result = localise_behind_wires(upright, calibration, parts, found.result.guide, known)
    if result is None:
        return image
    return replace(image, found=replace(found, result=result, reasons=result.reasons))


def why_no_holes(images: tuple[WiredImage, ...], parts: Parts) -> tuple[Reason, ...]:
    """Reasons when no image shows the nail's holes: those of the images that look along them, if there are any.

    An oblique image need not show them: that it does not is no reason.
    """
    along = [image for image in images if _looks_along(image, parts)]
    if along:
        told = (reason for image in along for reason in image.found.reasons)
        return tuple(Reason(one.code, f"{one.message}; or add an image from before the wires") for one in told)
    tilts = [tilt for image in images if (tilt := _tilt_deg(image, parts)) is not None]
    if not tilts:
        return tuple(reason for image in images for reason in image.found.reasons)
    return (
        Reason(
            ReasonCode.HOLE_NOT_VISIBLE,
            "no image looks along the nail's holes: the guide's are tilted by "
            f"{figure(min(tilts), LARGEST_TILT_DEG, 0)}° or more against the beam (limit {LARGEST_TILT_DEG:.0f}°); add "
            "an image along the wires, or one from before the wires",
        ),
    )


def tilt_of_guide_deg(guide: GuideFit, parts: Parts) -> float:
    """Angle between the mean direction of the guide's holes and the ray to about where they meet the nail."""
    drilling = unit(np.sum([hole.axis.direction for hole in parts.guide.holes], axis=0))
    ray = unit(guide.camera_from_guide @ (_TO_NAIL_MM * drilling))
    return float(np.degrees(angle_between_rad(guide.camera_from_guide.directions(drilling), ray)))


def _tilt_deg(image: WiredImage, parts: Parts) -> float | None:
    result = image.found.result
    return None if result is None or result.guide is None else tilt_of_guide_deg(result.guide, parts)


def _looks_along(image: WiredImage, parts: Parts) -> bool:
    tilt_deg = _tilt_deg(image, parts)
    return tilt_deg is not None and tilt_deg <= LARGEST_TILT_DEG
