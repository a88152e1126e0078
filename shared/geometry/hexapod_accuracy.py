"""How far the hexapod may be from the pose that it reports: the one source for all that allow for it. Pure.

The product's accuracy is a bound on each pose. An error that waves between such bounds has an rms of 0.71 of them, and
the bound in mm is of three axes together.
"""

from math import sqrt
from typing import Final

# Required of the hexapod (part files, maker's data): the largest deviation of a pose.
LARGEST_ERROR_MM: Final = 0.05
LARGEST_ERROR_DEG: Final = 0.02
# Standard deviations per axis: of one pose, and of a move from one pose to another, which errs at both ends.
POSE_SD_MM: Final = LARGEST_ERROR_MM / sqrt(6.0)
POSE_SD_DEG: Final = LARGEST_ERROR_DEG / sqrt(2.0)
MOVE_SD_MM: Final = sqrt(2.0) * POSE_SD_MM
MOVE_SD_DEG: Final = sqrt(2.0) * POSE_SD_DEG
