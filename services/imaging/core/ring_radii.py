"""How large the shadows of the ring's balls are: as found, or like others of their size."""

import numpy as np

from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.discs import Array


def found_radii_px(discs: BallCandidates, ring: RingPart) -> Array:
    """Radius of each of the ring's balls, NaN where none of the discs is it, shape (balls,)."""
    named = discs.ring_index != NOT_OF_THE_RING
    radius_px = np.full(len(ring.balls), np.nan)
    radius_px[discs.ring_index[named]] = discs.radius_px[named]
    return radius_px


def usual_radii_px(found_px: Array, ring: RingPart, otherwise_px: Array | None = None) -> Array:
    """Middle radius of the balls of each ball's size, shape (balls,).

    Parameters
    ----------
    found_px
        Radius of each ball, NaN where not found, shape (balls,); at least one is found unless `otherwise_px` is given.
    otherwise_px
        For balls of whose size none is found, shape (balls,); without it, the middle radius of all.
    """
    found = np.isfinite(found_px)
    usual_px = np.full(len(ring.balls), np.median(found_px[found])) if otherwise_px is None else otherwise_px.copy()
    for diameter in np.unique(ring.balls.diameter_mm[found]):
        same = ring.balls.diameter_mm == diameter
        usual_px[same] = np.median(found_px[same & found])
    return usual_px
