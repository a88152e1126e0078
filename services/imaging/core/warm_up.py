"""Compile what images are measured with before the first one waits for it."""

import numpy as np

from services.imaging.core.motion_blur import motion_blur_px
from services.imaging.core.seeds import make_seeds
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.xray.discs import compile_fits


def compile_core() -> None:
    """Run every compiled function once, on next to nothing; machine code of an earlier start is loaded instead."""
    compile_fits()
    place, one = np.array([[16.0, 16.0], [20.0, 16.0]]), np.ones(2)
    motion_blur_px(np.ones((32, 32), np.float32), place, one)
    discs = BallCandidates(place, one, one, one, np.full(2, NOT_OF_THE_RING, dtype=np.int64))
    make_seeds(discs, place, np.zeros(2, dtype=np.int64), 4.0)
