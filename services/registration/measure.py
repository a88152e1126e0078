"""Localise with a watch: the only thing the pure core leaves to its callers."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Method, Parts, Step, localise
from services.registration.report import MeasuredTimes, localisation_message
from shared.geometry.calibration import CArmCalibration
from shared.messages.registration import Localisation


def timed_localisation(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    parts: Parts,
    method: Method,
    image_sha256: str,
    ring_ms: float,
    clock_s: Callable[[], float] = time.perf_counter,
) -> tuple[LocalisationResult, Localisation]:
    """Localise in an image as received, and the message that tells of it with the time each step took.

    Parameters
    ----------
    ring_ms
        What calibrating took, which came before.
    """
    ends: dict[Step, float] = {}
    start = clock_s()
    result = localise(pixels, calibration, parts, method, lambda step: ends.update({step: clock_s()}))
    guide_ms = 1e3 * (ends[Step.GUIDE] - start)
    nail_ms = 1e3 * (ends[Step.NAIL] - ends[Step.GUIDE])
    times = MeasuredTimes(ring_ms + 1e3 * (clock_s() - start), ring_ms, guide_ms, nail_ms)
    return result, localisation_message(result, calibration, image_sha256, times)
