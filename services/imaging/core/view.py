"""The image un-mirrored, with what was found in it."""

from dataclasses import dataclass, replace

import numpy as np

from services.imaging.core.identification import RingIdentity
from services.imaging.core.ring_search import FoundRing
from shared.geometry.calibration import NOT_OF_THE_RING, Aperture, BallCandidates
from shared.xray.aperture import UsableArea
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The image un-mirrored, with what was found in it.

    Attributes
    ----------
    pixels, area
        Grey values, shape (rows, columns), and where they hold X-rays.
    mirrored
        Whether the image as received was the other way round.
    others
        Dark discs that are not the ring's.
    margin
        Identified balls of this identity minus those of the best different one.
    """

    pixels: FloatImage
    area: UsableArea
    mirrored: bool
    others: BallCandidates
    margin: float

    @property
    def centre_px(self) -> Array:
        """Middle of the usable area, shape (2,)."""
        if self.area.aperture is not None:
            return np.array(self.area.aperture.centre_px)
        rows, columns = self.pixels.shape
        return np.array([0.5 * (columns - 1), 0.5 * (rows - 1)])

    def measure(self, expected: Discs, settings: MeasurementSettings) -> BallMeasurements:
        """Measure the ring's balls, together with other discs that they touch."""
        return measure_balls(
            self.pixels,
            expected.centre_px,
            expected.radius_px,
            self.others.centre_px,
            self.others.radius_px,
            settings,
            self.area.mask,
        )


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
