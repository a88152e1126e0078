"""Which images are on record, by imaging's numbers, and what is still to come of them."""

import math
from bisect import bisect_right
from dataclasses import dataclass

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived


@dataclass(frozen=True, slots=True)
class NumbersOnRecord:
    """Numbers of one image store: all up to `through`, and ranges beyond it, each after a gap.

    A gap may never close, for the image that is missing may be in no store any more: what is held grows with the number
    of gaps, not with that of images.
    """

    through: int = 0
    beyond: tuple[tuple[int, int], ...] = ()  # first and last number of each range, increasing

    def __contains__(self, sequence: int) -> bool:
        if sequence <= self.through:
            return True
        after = bisect_right(self.beyond, (sequence, math.inf))
        return after > 0 and sequence <= self.beyond[after - 1][1]

    def with_number(self, sequence: int) -> "NumbersOnRecord":
        """One more, which may close a gap."""
        if sequence in self:
            return self
        at, first, last = bisect_right(self.beyond, (sequence, math.inf)), sequence, sequence
        before, after = self.beyond[:at], self.beyond[at:]
        if before and before[-1][1] == sequence - 1:
            first, before = before[-1][0], before[:-1]
        if after and after[0][0] == sequence + 1:
            last, after = after[0][1], after[1:]
        if first == self.through + 1:
            return NumbersOnRecord(last, after)
        return NumbersOnRecord(self.through, (*before, (first, last), *after))


@dataclass(frozen=True, slots=True)
class Unfinished:
    """Images of a case to which something is missing that is neither on record nor skipped, the newest first."""

    to_calibrate: tuple[ImageReceived, ...]
    to_localise: tuple[ImageReceived, ...]


def unfinished(case: Case) -> Unfinished:
    """What is missing. Of frames of running fluoroscopy only the newest image of the case counts, for its localisation.

    Images of older records have no number, and nobody can be asked for them.
    """
    calibrated = {one.image_sha256 for one in case.calibrations}
    finished = {one.image_sha256 for one in case.localisations} | {one.image_sha256 for one in case.skipped}
    numbered = [one for one in reversed(case.images) if one.sequence is not None and one.image_sha256 not in finished]
    newest = case.images[-1:]
    return Unfinished(
        tuple(one for one in numbered if not one.in_run and one.image_sha256 not in calibrated),
        tuple(one for one in numbered if one.image_sha256 in calibrated and (not one.in_run or one in newest)),
    )
