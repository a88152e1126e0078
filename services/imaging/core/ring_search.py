"""From pixels to the ring's balls by name: detect, identify, and say why when it fails."""

from dataclasses import dataclass, replace

import numpy as np

from services.imaging.core.ball_measurement import View
from services.imaging.core.checks import CLIPPED_SUSPECT, clipped_fraction, saturated_reason
from services.imaging.core.identification import RingIdentity, identify_ring
from services.imaging.core.nominal import NominalGeometry
from shared.errors import Reason, ReasonCode, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, Aperture, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea
from shared.xray.detection import detect_balls
from shared.xray.discs import Array, FloatImage

_RADIUS_TOLERANCE = 0.2
_LEAST_FRACTION = 0.2
_LEAST_BALLS = 16
_RUNNER_UP_LIMIT = 0.6


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
        What to look for, and nominal C-arm values.

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
    candidates = detect_balls(pixels, area.mask, searched_radii_px(ring, nominal))
    return _Search(candidates, identify_ring(candidates, ring, nominal))


def searched_radii_px(ring: RingPart, nominal: NominalGeometry) -> tuple[float, float]:
    """Least and largest radius of discs that are looked for."""
    low, high = nominal.ball_radius_range_px(ring)
    return low * (1.0 - _RADIUS_TOLERANCE), high * (1.0 + _RADIUS_TOLERANCE)


def _inverted(pixels: FloatImage, area: UsableArea) -> FloatImage:
    values = pixels[area.mask]
    return np.asarray(values.max() + values.min() - pixels, dtype=np.float32)


def _needed(ring: RingPart) -> int:
    return max(_LEAST_BALLS, int(np.ceil(_LEAST_FRACTION * len(ring.balls))))


def is_enough(identity: RingIdentity, ring: RingPart) -> bool:
    """Whether an identity explains enough of the ring's balls."""
    return identity.identified >= _needed(ring)


def is_ambiguous(identity: RingIdentity) -> bool:
    """Whether a different identity explains nearly as many."""
    return identity.runner_up > _RUNNER_UP_LIMIT * identity.identified


def _ambiguous_reason(identity: RingIdentity) -> Reason:
    limit = int(_RUNNER_UP_LIMIT * identity.identified)
    return Reason(
        ReasonCode.RING_AMBIGUOUS,
        f"one way to name the ring's balls explains {identity.identified}, a different one {identity.runner_up} "
        f"(limit {limit}); check that the ring's file fits this ring, uncover more of it and take another image",
    )


def _inverted_reason(identity: RingIdentity) -> Reason:
    return Reason(
        ReasonCode.IMAGE_UNUSABLE,
        f"{identity.identified} of the ring's balls are brighter than their surroundings (limit 0): the image is "
        "inverted and carries no tag that says so; switch the C-arm's display to dark metal and send it again",
    )


def _not_found_reasons(found: _Search, pixels: FloatImage, area: UsableArea, ring: RingPart) -> tuple[Reason, ...]:
    explained = 0 if found.identity is None else found.identity.identified
    reasons = [
        Reason(
            ReasonCode.RING_NOT_FOUND,
            f"of {len(found.candidates.radius_px)} dark discs at most {explained} fit the ring's pattern of "
            f"{len(ring.balls)} balls (at least {_needed(ring)}); check that the ring is mounted, that its file is the "
            "right one and that the nominal C-arm values are within 10 %",
        )
    ]
    clipped = clipped_fraction(pixels, area.mask)
    if clipped > CLIPPED_SUSPECT:
        reasons.append(saturated_reason(clipped, CLIPPED_SUSPECT))
    return tuple(reasons)


def upright_discs(found: FoundRing, columns: int) -> BallCandidates:
    """All discs, in the un-mirrored image of so many columns, those of the ring with their ball's index."""
    identity, candidates = found.identity, found.candidates
    index = np.full(len(candidates.radius_px), NOT_OF_THE_RING, dtype=np.int64)
    known = np.flatnonzero(identity.candidate_of_ball >= 0)
    index[identity.candidate_of_ball[known]] = known
    centre = _upright(candidates.centre_px, columns) if identity.mirrored else candidates.centre_px
    return replace(candidates, centre_px=centre, ring_index=index)


def view_of(pixels: FloatImage, area: UsableArea, identity: RingIdentity, discs: BallCandidates) -> View:
    """Turn the image so that it obeys physics: a mirrored one is reflected, column x becomes W - 1 - x.

    Parameters
    ----------
    pixels, area, identity
        As received.
    discs
        As `upright_discs` makes them.
    """
    if identity.mirrored:
        pixels, area = np.ascontiguousarray(pixels[:, ::-1]), _mirrored(area)
    others = discs.select(discs.ring_index == NOT_OF_THE_RING)
    return View(pixels, area, identity.mirrored, others, float(identity.identified - identity.runner_up))


def _upright(places_px: Array, columns: int) -> Array:
    """Places (x, y) of a mirrored image of so many columns in the un-mirrored one, shape (N, 2)."""
    return np.column_stack([columns - 1 - places_px[:, 0], places_px[:, 1]])


def _mirrored(area: UsableArea) -> UsableArea:
    circle = area.aperture
    if circle is not None:
        x, y = _upright(np.array([circle.centre_px]), area.mask.shape[1])[0]
        circle = Aperture((float(x), float(y)), circle.radius_px)
    return UsableArea(np.ascontiguousarray(area.mask[:, ::-1]), circle)
