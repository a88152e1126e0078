"""Which images are on record, by imaging's numbers, and what is still to come of them."""

from dataclasses import dataclass

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived


@dataclass(frozen=True, slots=True)
class NumbersOnRecord:
    """Numbers of one image store: all up to `through`, and those `beyond` a gap."""

    through: int = 0
    beyond: frozenset[int] = frozenset()

    def __contains__(self, sequence: int) -> bool:
        return sequence <= self.through or sequence in self.beyond

    def with_number(self, sequence: int) -> "NumbersOnRecord":
        """One more, which may close a gap."""
        beyond, through = self.beyond | {sequence}, self.through
        while through + 1 in beyond:
            through += 1
        return NumbersOnRecord(through, frozenset(number for number in beyond if number > through))


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
