"""The image un-mirrored, with the ring's balls where they are thought to be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import FoundRing
from shared.geometry.calibration import NOT_OF_THE_RING, Aperture, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls

# Shadows look smaller than geometry says: a ball's rim absorbs little, and bright air swallows it.
_SHRUNK = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The image un-mirrored, with what was found in it.

    Attributes
    ----------
    pixels, area
        Grey values, shape (rows, columns), and where they hold X-rays.
    mirrored
        Whether the image as received was the other way round.
    predicted
        Where the ring's balls must be, with the radius they seem to have.
    others
        Dark discs that are not the ring's.
    margin
        Identified balls of this identity minus those of the best different one.
    """

    pixels: FloatImage
    area: UsableArea
    mirrored: bool
    predicted: Discs
    others: BallCandidates
    margin: float

    @property
    def centre_px(self) -> Array:
        """Middle of the usable area, shape (2,)."""
        if self.area.aperture is not None:
            return np.array(self.area.aperture.centre_px)
        rows, columns = self.pixels.shape
        return np.array([0.5 * (columns - 1), 0.5 * (rows - 1)])

    def measure(self, predicted: Discs, settings: MeasurementSettings) -> BallMeasurements:
        """Measure the ring's balls, together with other discs that they touch."""
        return measure_balls(
            self.pixels,
            predicted.centre_px,
            predicted.radius_px,
            self.others.centre_px,
            self.others.radius_px,
            settings,
            self.area.mask,
        )


def view_of(pixels: FloatImage, area: UsableArea, found: FoundRing, ring: RingPart, nominal: NominalGeometry) -> View:
    """Turn image and discs so that they obey physics: a mirrored image is reflected, column x becomes W - 1 - x."""
    identity = found.identity
    centre, predicted = found.candidates.centre_px.copy(), identity.predicted_px.copy()
    if identity.mirrored:
        last = pixels.shape[1] - 1
        centre[:, 0], predicted[:, 0] = last - centre[:, 0], last - predicted[:, 0]
        pixels, area = np.ascontiguousarray(pixels[:, ::-1]), _mirrored(area)
    known = identity.candidate_of_ball >= 0
    of_the_ring = identity.candidate_of_ball[known]
    radius = _SHRUNK * nominal.ball_radii_px(ring)
    radius[known] = found.candidates.radius_px[of_the_ring]
    return View(
        pixels=pixels,
        area=area,
        mirrored=identity.mirrored,
        predicted=Discs(predicted, radius),
        others=_without(found.candidates, centre, of_the_ring),
        margin=float(identity.identified - identity.runner_up),
    )


def _without(candidates: BallCandidates, centre: Array, of_the_ring: NDArray[np.int64]) -> BallCandidates:
    other = np.ones(len(centre), dtype=bool)
    other[of_the_ring] = False
    return BallCandidates(
        centre_px=centre[other],
        radius_px=candidates.radius_px[other],
        contrast=candidates.contrast[other],
        standard_deviation_px=candidates.standard_deviation_px[other],
        ring_index=np.full(int(other.sum()), NOT_OF_THE_RING, dtype=np.int64),
    )


def _mirrored(area: UsableArea) -> UsableArea:
    circle = area.aperture
    if circle is not None:
        last = area.mask.shape[1] - 1
        circle = Aperture((last - circle.centre_px[0], circle.centre_px[1]), circle.radius_px)
    return UsableArea(np.ascontiguousarray(area.mask[:, ::-1]), circle)
