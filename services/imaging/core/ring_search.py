"""From pixels to the ring's identified balls, or the reasons why there are none."""

from dataclasses import dataclass, replace

import numpy as np

from services.imaging.core.acceptance import (
    CLIPPED_WITHOUT_RING,
    INVERTED,
    RING_BALLS_IDENTIFIED,
    RING_SHARE_IDENTIFIED,
    SECOND_IDENTITY,
)
from services.imaging.core.ball_measurement import UprightImage
from services.imaging.core.checks import balls_needed, clipped_reason
from services.imaging.core.identification import RingIdentity, identify_ring
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.tuning import RING_DETECTION
from shared.errors import Reason, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, Aperture, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea
from shared.xray.detection import detect_balls
from shared.xray.discs import Array, FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class FoundRing:
    """The ring in the image as received.

    Attributes
    ----------
    candidates
        All dark discs.
    identity
        Which of them is which ball.
    """

    candidates: BallCandidates
    identity: RingIdentity


def find_ring(pixels: FloatImage, area: UsableArea, ring: RingPart, nominal: NominalGeometry) -> FoundRing | Rejected:
    """Detect dark discs and identify the ring among them.

    Parameters
    ----------
    pixels, area
        Image as received, darker is denser, and its usable area.
    ring, nominal
        The ring to find, and nominal C-arm values.

    Returns
    -------
    FoundRing or Rejected
        Rejected with `ring_not_found`, `ring_ambiguous`, `saturated` or `image_unusable` (inverted).
    """
    found = _search(pixels, area, ring, nominal)
    if isinstance(found.identity, RingIdentity) and is_enough(found.identity, ring):
        if is_ambiguous(found.identity):
            return Rejected((_ambiguous_reason(found.identity),))
        return FoundRing(found.candidates, found.identity)
    inverted = _search(_inverted(pixels, area), area, ring, nominal)
    if inverted.identity is not None and is_enough(inverted.identity, ring) and not is_ambiguous(inverted.identity):
        return Rejected((_inverted_reason(inverted.identity),))
    return Rejected(_not_found_reasons(found, pixels, area, ring))


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    candidates: BallCandidates
    identity: RingIdentity | None


def _search(pixels: FloatImage, area: UsableArea, ring: RingPart, nominal: NominalGeometry) -> _Search:
    candidates = detect_balls(pixels, area.mask, searched_radii_px(ring, nominal), pixel_mm=nominal.pixel_mm)
    return _Search(candidates, identify_ring(candidates, ring, nominal))


def searched_radii_px(ring: RingPart, nominal: NominalGeometry) -> tuple[float, float]:
    """Least and largest radius of discs that are sought."""
    low, high = nominal.ball_radius_range_px(ring)
    return low * (1.0 - RING_DETECTION.radius_tolerance), high * (1.0 + RING_DETECTION.radius_tolerance)


def _inverted(pixels: FloatImage, area: UsableArea) -> FloatImage:
    values = pixels[area.mask]
    return np.asarray(values.max() + values.min() - pixels, dtype=np.float32)


def _needed(ring: RingPart) -> int:
    return max(int(RING_BALLS_IDENTIFIED.limit.value), balls_needed(RING_SHARE_IDENTIFIED, ring))


def is_enough(identity: RingIdentity, ring: RingPart) -> bool:
    """Whether an identity explains enough of the ring's balls."""
    return identity.identified >= _needed(ring)


def is_ambiguous(identity: RingIdentity) -> bool:
    """Whether a different identity explains nearly as many."""
    return not SECOND_IDENTITY.is_met(_runner_up_share(identity))


def _runner_up_share(identity: RingIdentity) -> float:
    return identity.runner_up / identity.identified


def _ambiguous_reason(identity: RingIdentity) -> Reason:
    share = SECOND_IDENTITY.quoted(_runner_up_share(identity))
    return SECOND_IDENTITY.reason(
        f"one identity explains {identity.identified} of the ring's balls, another one {identity.runner_up}: {share}"
    )


def _inverted_reason(identity: RingIdentity) -> Reason:
    return INVERTED.reason(
        f"{identity.identified} of the ring's balls are brighter than their surroundings: the image is inverted and "
        "carries no tag that marks it as such"
    )


def _not_found_reasons(found: _Search, pixels: FloatImage, area: UsableArea, ring: RingPart) -> tuple[Reason, ...]:
    explained = 0 if found.identity is None else found.identity.identified
    not_found = RING_BALLS_IDENTIFIED.reason(
        f"of {len(found.candidates.radius_px)} dark discs at most {explained} fit the ring's pattern of "
        f"{len(ring.balls)} balls (at least {_needed(ring)})"
    )
    clipped = clipped_reason(pixels[area.mask], CLIPPED_WITHOUT_RING)
    return (not_found,) if clipped is None else (not_found, clipped)


def upright_discs(found: FoundRing, columns: int) -> BallCandidates:
    """All discs, in the un-mirrored image of so many columns, those of the ring with their ball's index."""
    identity, candidates = found.identity, found.candidates
    index = np.full(len(candidates.radius_px), NOT_OF_THE_RING, dtype=np.int64)
    known = np.flatnonzero(identity.candidate_of_ball >= 0)
    index[identity.candidate_of_ball[known]] = known
    centre = _upright(candidates.centre_px, columns) if identity.mirrored else candidates.centre_px
    return replace(candidates, centre_px=centre, ring_index=index)


def upright_image(
    pixels: FloatImage, area: UsableArea, identity: RingIdentity, discs: BallCandidates, pixel_mm: float
) -> UprightImage:
    """Un-mirror the image: in a mirrored one, column x becomes W - 1 - x.

    Parameters
    ----------
    pixels, area, identity
        As received.
    discs
        As `upright_discs` makes them.
    pixel_mm
        Nominal pixel pitch at the detector.
    """
    if identity.mirrored:
        pixels, area = np.ascontiguousarray(pixels[:, ::-1]), _mirrored(area)
    others = discs.select(discs.ring_index == NOT_OF_THE_RING)
    margin = float(identity.identified - identity.runner_up)
    return UprightImage(pixels, area, identity.mirrored, others, margin, pixel_mm)


def _upright(places_px: Array, columns: int) -> Array:
    """Places (x, y) of a mirrored image of so many columns in the un-mirrored one, shape (N, 2)."""
    return np.column_stack([columns - 1 - places_px[:, 0], places_px[:, 1]])


def _mirrored(area: UsableArea) -> UsableArea:
    circle = area.aperture
    if circle is not None:
        x, y = _upright(np.array([circle.centre_px]), area.mask.shape[1])[0]
        circle = Aperture((float(x), float(y)), circle.radius_px)
    return UsableArea(np.ascontiguousarray(area.mask[:, ::-1]), circle)
