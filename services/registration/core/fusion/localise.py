"""Several localised images of one set-up to one localisation: which count, what they say together, the verdict."""

from dataclasses import dataclass, replace

import numpy as np

from services.registration.core.acceptance.image import uncertainty_reasons
from services.registration.core.acceptance.images import chi_square_limit
from services.registration.core.fusion.agreement import disagreement, leave_one_out
from services.registration.core.fusion.fuse import fuse
from services.registration.core.hole_axes import holes_at
from services.registration.core.localise import LocalisationResult, Parts, evidence_of
from services.registration.core.pose_evidence import PoseEvidence
from shared.errors import Reason, ReasonCode
from shared.geometry.calibration import CArmCalibration

# A lone image may not be certain enough: together with others it may be. All other reasons make it useless.
_USABLE_THOUGH = frozenset({ReasonCode.UNCERTAINTY_TOO_LARGE})


@dataclass(frozen=True, slots=True, eq=False)
class LocalisedImage:
    """One image with what was found in it; calibration and result are None when the ring was not found.

    Attributes
    ----------
    name
        What it is called in sentences for people.
    reasons
        Why it was rejected.
    """

    name: str
    calibration: CArmCalibration | None
    result: LocalisationResult | None
    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True)
class ImageShare:
    """What became of one image.

    Attributes
    ----------
    used
        Whether the joint estimate rests on it.
    chi_square
        By how much the joint chi-square grew through it; about 9 when all is well. None when it was not used, or alone.
    """

    used: bool
    chi_square: float | None


@dataclass(frozen=True, slots=True, eq=False)
class FusedLocalisation:
    """What several images say together.

    Attributes
    ----------
    result
        As if from one image: what belongs to an image (guide and nail in the camera's frame, tilts, the C-arm's
        correction) is that of image `shown`, the newest that was used.
    shown
        Its index; the last image's when none was used.
    chi_square, chi_square_limit, degrees_of_freedom
        How well the images agree; zero for fewer than two.
    """

    result: LocalisationResult
    shown: int
    shares: tuple[ImageShare, ...]
    chi_square: float
    chi_square_limit: float
    degrees_of_freedom: int


def fuse_localisations(images: tuple[LocalisedImage, ...], parts: Parts) -> FusedLocalisation | None:
    """Join the images of one set-up, in the order in which they were taken; None when no image can be used.

    Used is every image that was accepted, or rejected for nothing but its own uncertainty.
    """
    evidence = {k: one for k, image in enumerate(images) if (one := usable_evidence(image, parts)) is not None}
    if not evidence:
        return None
    used, found = tuple(evidence), tuple(evidence.values())
    shown = used[-1]
    newest = images[shown].result
    assert newest is not None  # `usable_evidence` needs one
    if len(used) == 1:
        shares = tuple(ImageShare(k == shown, None) for k in range(len(images)))
        return FusedLocalisation(newest, shown, shares, 0.0, 0.0, 0)
    joint = fuse(found)
    influence = dict(zip(used, leave_one_out(found), strict=True))
    shares = tuple(ImageShare(k in influence, _share(influence.get(k))) for k in range(len(images)))
    return FusedLocalisation(
        _joint_result(images, used, found, parts, newest),
        shown,
        shares,
        joint.chi_square,
        chi_square_limit(joint.degrees_of_freedom),
        joint.degrees_of_freedom,
    )


def usable_evidence(image: LocalisedImage, parts: Parts) -> PoseEvidence | None:
    """What an image says of `guide_from_nail`; None when it cannot be used."""
    result, calibration = image.result, image.calibration
    if calibration is None or result is None or result.guide is None or result.nail is None:
        return None
    if any(reason.code not in _USABLE_THOUGH for reason in image.reasons):
        return None
    return evidence_of(calibration, parts, result.guide, result.nail)


def _share(chi_square: np.float64 | None) -> float | None:
    return None if chi_square is None else max(float(chi_square), 0.0)


def _joint_result(
    images: tuple[LocalisedImage, ...],
    used: tuple[int, ...],
    evidence: tuple[PoseEvidence, ...],
    parts: Parts,
    newest: LocalisationResult,
) -> LocalisationResult:
    """The joint estimate in the newest result's place; that one stays, refused, when the images disagree."""
    assert newest.nail is not None  # `usable_evidence` needs one
    camera_from_nail = newest.nail.camera_from_nail
    against = disagreement(evidence, tuple(images[k].name for k in used), parts, camera_from_nail)
    if against is not None:
        return replace(newest, reasons=(against,))
    joint = fuse(evidence)
    holes = holes_at(parts.nail, parts.drill_diameter_mm, joint.guide_from_nail, joint.covariance, camera_from_nail)
    return replace(newest, reasons=uncertainty_reasons(holes), guide_from_nail=joint.guide_from_nail, holes=holes)
