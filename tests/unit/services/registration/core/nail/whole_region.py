"""The region of a fit in an image that shows nothing."""

import numpy as np

from services.registration.core.nail.imaging_chain import Sampling
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.region import FitInput, FitRegion, cut_region
from tests.unit.services.registration.xray_scene import calibration, nail_part, posed_nail

SIDE = 1024


def region() -> FitRegion:
    pixels = np.full((SIDE, SIDE), 1000.0, dtype=np.float32)
    cut = cut_region(
        FitInput(pixels, calibration(SIDE), nail_part(), Occluders(None, None)),
        posed_nail(0.0),
        6.0,
        Sampling(1, 0.0, 0.235),
    )
    assert cut is not None
    return cut


REGION = region()
