"""Localise with a watch: the only thing the pure core leaves to its callers."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.registration.core.localise import LocalisationResult, Parts, Step, localise
from services.registration.report import MeasuredTimes, localisation_message
from shared.geometry.calibration import CArmCalibration
from shared.messages.registration import Localisation, Method

Localiser = Callable[[NDArray[np.float32], CArmCalibration, Parts, Callable[[Step], None]], LocalisationResult]


def timed_localisation(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    parts: Parts,
    image_sha256: str,
    ring_ms: float,
    method: tuple[Method, Localiser] = ("model", localise),
    clock_s: Callable[[], float] = time.perf_counter,
) -> tuple[LocalisationResult, Localisation]:
    """Localise in an image as received, and its message with the time each step took.

    Parameters
    ----------
    ring_ms
        Duration of the calibration, which came before.
    method
        Its name in the message, and the function that localises.
    """
    ends: dict[Step, float] = {}
    start = clock_s()
    name, localise_by = method
    result = localise_by(pixels, calibration, parts, lambda step: ends.update({step: clock_s()}))
    guide_ms = 1e3 * (ends[Step.GUIDE] - start)
    nail_ms = 1e3 * (ends[Step.NAIL] - ends[Step.GUIDE])
    times = MeasuredTimes(ring_ms + 1e3 * (clock_s() - start), ring_ms, guide_ms, nail_ms)
    return result, localisation_message(result, calibration, image_sha256, times, name)
