"""What a fit may move: the pose and the nuisances, their order, and what is known of them before the image is seen."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

_MOST_DEVIATIONS = 6.0
_MOST_RADIUS_EXCESS_MM = 0.6


class Unknown(IntEnum):
    """Place of each unknown in the parameter vector; the first six are the pose (`pose.py`)."""

    FIRST_X_PX = 0
    FIRST_Y_PX = 1
    SECOND_X_PX = 2
    SECOND_Y_PX = 3
    PITCH_RAD = 4
    ROLL_RAD = 5
    HOLE_RADIUS_EXCESS_MM = 6
    NAIL_RADIUS_EXCESS_MM = 7
    CHAMFER_DEVIATIONS = 8
    LOG_ATTENUATION = 9
    HARDENING = 10
    LOG_BLUR_PX = 11
    TAIL_SHARE = 12
    LOG_TAIL_WIDTH = 13
    SHARPENING = 14
    LOG_SHARPENING_WIDTH_PX = 15
    CURVE = 16
    CURVE_EXPONENT = 17
    DELRIN_PER_MM = 18


PARAMETERS = len(Unknown)
# What the nail's file says of the nail, more or less: it is the same in every image of that nail.
SHAPE_UNKNOWNS = (Unknown.HOLE_RADIUS_EXCESS_MM, Unknown.NAIL_RADIUS_EXCESS_MM, Unknown.CHAMFER_DEVIATIONS)

# Mean and standard deviation of what is known before the image is seen. Attenuation: the mean of the X-rays that pass
# 100-200 mm of muscle at 60-80 kV; hardening: `shade.py`.
ATTENUATION_PER_MM = {"steel": 1.6, "Ti6Al4V": 0.5}
# Rims are at least deburred. An image hardly shows by how much, and a tilt is off by a tenth of what a chamfer hides of
# the bore's length: so the files of nails should say it.
USUAL_CHAMFER_MM, USUAL_CHAMFER_SD_MM, STATED_CHAMFER_SD_MM = 0.15, 0.15, 0.05
STEEL_IN_NAIL_MATERIAL = {"steel": 1.0, "Ti6Al4V": 3.2}
PRIOR = {
    Unknown.HOLE_RADIUS_EXCESS_MM: (0.0, 0.03),
    Unknown.NAIL_RADIUS_EXCESS_MM: (0.0, 0.03),
    Unknown.CHAMFER_DEVIATIONS: (0.0, 1.0),
    Unknown.LOG_ATTENUATION: (0.0, 0.5),
    Unknown.HARDENING: (0.65, 0.3),
    Unknown.LOG_BLUR_PX: (float(np.log(1.2)), 0.35),
    Unknown.TAIL_SHARE: (0.2, 0.15),
    Unknown.LOG_TAIL_WIDTH: (float(np.log(2.2)), 0.2),
    Unknown.SHARPENING: (0.2, 0.4),
    Unknown.LOG_SHARPENING_WIDTH_PX: (float(np.log(2.5)), 0.4),
    Unknown.CURVE: (0.3, 0.3),
    Unknown.CURVE_EXPONENT: (0.4, 0.25),
    Unknown.DELRIN_PER_MM: (0.02, 0.02),
}

# Displays lie between logarithmic (0) and linear (1, where the curve would have no bend left).
_LEAST_EXPONENT, _MOST_EXPONENT = -0.4, 0.9
_MOST_TAIL = 0.8
_RADII = (Unknown.HOLE_RADIUS_EXCESS_MM, Unknown.NAIL_RADIUS_EXCESS_MM)


def _reach_of(unknown: Unknown) -> float:
    """How far from its prior's mean a parameter may go; radii far enough to tell another nail."""
    if unknown not in PRIOR:
        return float("inf")
    return _MOST_RADIUS_EXCESS_MM if unknown in _RADII else _MOST_DEVIATIONS * PRIOR[unknown][1]


_REACH = np.array([_reach_of(unknown) for unknown in Unknown])


_MEAN = np.array([PRIOR[u][0] if u in PRIOR else 0.0 for u in Unknown])
_PRECISION = np.array([PRIOR[u][1] ** -2 if u in PRIOR else 0.0 for u in Unknown])


def prior_mean() -> NDArray[np.float64]:
    """Shape (PARAMETERS,); zero for the pose."""
    return _MEAN.copy()


def prior_precision() -> NDArray[np.float64]:
    """Inverse variances, shape (PARAMETERS,); zero for the pose."""
    return _PRECISION.copy()


def within_reason(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nuisances clipped to where they still mean something, mostly six standard deviations of their prior."""
    clipped = np.clip(parameters, prior_mean() - _REACH, prior_mean() + _REACH)
    exponent = Unknown.CURVE_EXPONENT
    clipped[exponent] = np.clip(clipped[exponent], _LEAST_EXPONENT, _MOST_EXPONENT)
    clipped[Unknown.HARDENING] = max(clipped[Unknown.HARDENING], 0.0)
    # below, the curve is straight and nothing would tell the way back
    clipped[Unknown.CURVE] = max(clipped[Unknown.CURVE], 0.0)
    clipped[Unknown.TAIL_SHARE] = np.clip(clipped[Unknown.TAIL_SHARE], 0.0, _MOST_TAIL)
    return np.asarray(clipped)
