"""One length of a built part beside its file: what no single image shows, and a calliper does.

A guide that is larger than its file and farther away by the same share looks the same in every image of one direction,
but the nail's distance from it is then wrong. A ring whose plates are nearer together than filed gives too short a
focal length, which its own balls do not contradict (decision 21).
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from shared.errors import PartFileInvalid
from shared.geometry.parts import BallPattern

# A guide 0.3 % larger than filed puts the nail 2 mm off along a ray of 700 mm, which moves an entry point by 0.2 mm at
# 5 degrees of tilt; a calliper reads 0.05 mm in 40, 0.13 %.
LARGEST_SHARE_OFF: Final = 0.003
# A length much shorter than the part could not be measured to that share.
LEAST_SHARE_OF_PART: Final = 0.6
# Of a ring's length along z: across the beam it would not show how far apart the plates are.
LEAST_SHARE_ALONG_BEAM: Final = 0.7


class MeasuredLength(BaseModel):
    """Distance between the centres of two balls of a part, as somebody measured it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    first: str = Field(min_length=1, max_length=64)
    second: str = Field(min_length=1, max_length=64)
    measured_mm: float = Field(gt=0.0, lt=1000.0, allow_inf_nan=False)

    @property
    def label(self) -> str:
        """For lists: the balls and the length."""
        return f"{self.first} to {self.second} measured as {self.measured_mm:g} mm"


def check_length_of_guide(balls: BallPattern, length: MeasuredLength) -> None:
    """Refuse a guide of another size than its file says.

    Raises
    ------
    PartFileInvalid
        With what was measured, the limit and the remedy.
    """
    filed_mm = _between(balls, length)
    places = balls.position_mm
    longest_mm = float(np.linalg.norm(places[:, None] - places[None], axis=-1).max())
    if float(np.linalg.norm(filed_mm)) < LEAST_SHARE_OF_PART * longest_mm:
        raise PartFileInvalid(
            f"--length: {length.first} and {length.second} are {np.linalg.norm(filed_mm):.1f} mm apart in the file; "
            f"name two balls at least {LEAST_SHARE_OF_PART * longest_mm:.1f} mm apart ({LEAST_SHARE_OF_PART:.0%} of "
            "the longest distance)"
        )
    _check_share(filed_mm, length, "guide")


def check_length_of_ring(balls: BallPattern, length: MeasuredLength) -> None:
    """Refuse a ring whose plates are not as far apart as its file says; raises as `check_length_of_guide`."""
    filed_mm = _between(balls, length)
    along = abs(float(filed_mm[2])) / float(np.linalg.norm(filed_mm))
    if along < LEAST_SHARE_ALONG_BEAM:
        raise PartFileInvalid(
            f"--length: from {length.first} to {length.second} {along:.0%} of the way is along the beam (at least "
            f"{LEAST_SHARE_ALONG_BEAM:.0%}); name a ball of either plate, one about above the other"
        )
    _check_share(filed_mm, length, "ring")


def _between(balls: BallPattern, length: MeasuredLength) -> NDArray[np.float64]:
    """From the first ball to the second in the file, shape (3,), in mm."""
    unknown = [ball for ball in (length.first, length.second) if ball not in balls.ids]
    if unknown or length.first == length.second:
        wrong = f"the file has no ball '{unknown[0]}'" if unknown else f"'{length.first}' is named twice"
        raise PartFileInvalid(f"--length: {wrong}; name two balls of {balls.ids[0]} to {balls.ids[-1]}")
    first, second = (balls.position_mm[balls.ids.index(ball)] for ball in (length.first, length.second))
    return np.asarray(second - first)


def _check_share(filed_mm: NDArray[np.float64], length: MeasuredLength, part: str) -> None:
    distance_mm = float(np.linalg.norm(filed_mm))
    off = length.measured_mm / distance_mm - 1.0
    if abs(off) > LARGEST_SHARE_OFF:
        raise PartFileInvalid(
            f"--length: {length.label}, in the file they are {distance_mm:.2f} mm apart: {off:+.1%} (limit "
            f"{LARGEST_SHARE_OFF:.1%}); measure again, and if it stays so correct the file or do not use this {part}: "
            "no single image shows its size"
        )
