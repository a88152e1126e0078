"""From localised images of one set-up to its wires, by way of what is known before the wires are looked at.

The images that show the nail's holes, beside the wires, are fused, with earlier ones from before the wires if there
are any. In the others the guide is found, with their help if it must be, and the nail's outline ties guide and nail.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion.agreement import disagreement
from services.registration.core.fusion.fuse import fuse
from services.registration.core.fusion.localise import LocalisedImage, usable_evidence
from services.registration.core.guide.locate import GuideFit
from services.registration.core.localise import LocalisationResult, Parts, unmirrored
from services.registration.core.pose_evidence import PoseEvidence
from services.registration.core.wires.companion import locate_guide_beside
from services.registration.core.wires.outline_fit import with_outline
from services.registration.core.wires.set_up import SetUp, set_up_of
from services.registration.core.wires.verify import WireVerification, verify_wires
from services.registration.core.wires.view import WireView
from services.registration.core.wires.wired_image import WiredImage, beside_wires, why_no_holes
from shared.errors import Accepted, Reason, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Guide, Nail
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class SeenSetUp:
    """What the images give.

    Attributes
    ----------
    set_up
        None when no image shows the nail's holes, or none the guide, or they contradict one another.
    reasons
        Why there is no set-up, or why some image is not in it.
    used
        Names of the images that are in it.
    """

    set_up: SetUp | None
    reasons: tuple[Reason, ...]
    used: tuple[str, ...]


def verify_images(
    images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts
) -> WireVerification:
    """Measure the wires in one image or more; an image that is left out tells why when the others do not suffice."""
    return verify_seen(tuple(beside_wires(image, parts) for image in images), earlier, parts)


def verify_seen(images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts) -> WireVerification:
    """The same for images in which the nail has been looked for behind the wires (`beside_wires`)."""
    seen = seen_set_up(images, earlier, parts)
    if seen.set_up is None:
        return WireVerification(seen.reasons, (), ())
    verified = replace(verify_wires(seen.set_up, parts.guide, parts.nail), images_used=seen.used)
    if not verified.reasons or len(seen.used) == len(images):
        return verified
    return replace(verified, reasons=verified.reasons + seen.reasons)


def seen_set_up(images: tuple[WiredImage, ...], earlier: tuple[LocalisedImage, ...], parts: Parts) -> SeenSetUp:
    """Put everything together that images with wires, and earlier ones without, say of guide and nail.

    Parameters
    ----------
    earlier
        Of the same set-up, in the order in which they were taken.
    """
    all_images = (*earlier, *(image.found for image in images))
    evidence = {id(one): told for one in all_images if (told := usable_evidence(one, parts)) is not None}
    used = tuple(one for one in all_images if id(one) in evidence)
    if not used:
        return SeenSetUp(None, why_no_holes(images, parts), ())
    found = tuple(evidence[id(one)] for one in used)
    against = _against(used, found, parts)
    if against is not None:
        return SeenSetUp(None, (against,), ())
    joint = fuse(found)
    seen, reasons = _views(images, parts, joint.guide_from_nail)
    if not seen:
        return SeenSetUp(None, reasons, ())
    source = tuple(used.index(one.image) if id(one.image) in evidence else None for one in seen)
    set_up = set_up_of(tuple(one.view for one in seen), joint, source)
    return _outlined(set_up, source, seen, parts, reasons)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """An image in which the guide was found."""

    image: LocalisedImage
    view: WireView


def _views(
    images: tuple[WiredImage, ...], parts: Parts, guide_from_nail: Transform[Guide, Nail]
) -> tuple[tuple[_Seen, ...], tuple[Reason, ...]]:
    """The images in which the guide was found, and why it was not in the others."""
    seen: list[_Seen] = []
    reasons: list[Reason] = []
    for image in images:
        view = _view(image, parts, guide_from_nail)
        if isinstance(view, Rejected):
            reasons.extend(view.reasons)
        else:
            seen.append(_Seen(image.found, view))
    return tuple(seen), tuple(reasons)


def _outlined(
    set_up: SetUp, source: tuple[int | None, ...], seen: tuple[_Seen, ...], parts: Parts, reasons: tuple[Reason, ...]
) -> SeenSetUp:
    """The set-up corrected by the nail's outline in the images that do not show its holes, if that is where it must be.

    No image may have shown the holes since the wires went in: only the outline tells then whether the guide slipped.
    """
    for k, one in enumerate(seen):
        if source[k] is None:
            outlined = with_outline(set_up, k, parts.guide, parts.nail)
            against = outlined.departure.reason(one.image.name)
            if against is not None:
                return SeenSetUp(None, (against,), ())
            set_up = outlined.set_up
    return SeenSetUp(set_up, reasons, tuple(one.image.name for one in seen))


def _against(used: tuple[LocalisedImage, ...], evidence: tuple[PoseEvidence, ...], parts: Parts) -> Reason | None:
    newest = used[-1].result
    assert newest is not None  # `usable_evidence` needs one
    assert newest.nail is not None
    return disagreement(evidence, tuple(one.name for one in used), parts.nail, newest.nail.camera_from_nail)


def _view(image: WiredImage, parts: Parts, guide_from_nail: Transform[Guide, Nail]) -> WireView | Rejected:
    """The guide in one image: as it was found there, else with the help of what the others say of the nail."""
    calibration, result = image.found.calibration, image.found.result
    if calibration is None:
        return Rejected(image.found.reasons)
    upright = unmirrored(image.pixels, calibration)
    guide = _guide(upright, calibration, result, parts, guide_from_nail)
    if isinstance(guide, Rejected):
        return guide
    return WireView(upright, calibration, guide.value.camera_from_guide, guide.value.covariance)


def _guide(
    upright: NDArray[np.float32],
    calibration: CArmCalibration,
    result: LocalisationResult | None,
    parts: Parts,
    guide_from_nail: Transform[Guide, Nail],
) -> Accepted[GuideFit] | Rejected:
    if result is not None and result.guide is not None:
        return Accepted(result.guide)
    return locate_guide_beside(upright, calibration, parts, guide_from_nail)
