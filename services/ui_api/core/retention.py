"""What may be pruned, by rule: pure, no database and no files."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived

DAY_NS: Final = 24 * 3600 * 10**9  # of the units
# 10 years: what the German Radiation Protection Act (section 85) demands for X-ray examinations of adults.
CLOSED_DAYS: Final = 3653
# Chosen: long enough to look at a procedure again while it is remembered.
FRAMES_DAYS: Final = 30
_SHA256: Final = re.compile(r"\b[0-9a-f]{64}\b")

Ranges = tuple[tuple[int, int], ...]


def hashes_in(data_json: str) -> frozenset[str]:
    """Every SHA-256 that an event's data names, of documents and images alike, at any depth and under any key."""
    return frozenset(_SHA256.findall(data_json))


def as_ranges(numbers: Iterable[int]) -> Ranges:
    """Numbers as ranges from the first to the last."""
    ranges: list[tuple[int, int]] = []
    for number in sorted(set(numbers)):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], number)
        else:
            ranges.append((number, number))
    return tuple(ranges)


@dataclass(frozen=True, slots=True)
class RetentionRules:
    """For how long what is kept; in days, since a case was closed or an image received.

    Attributes
    ----------
    closed_days
        Closed cases: all of them, with documents and images.
    frames_days
        Files of frames of running fluoroscopy from which nothing was measured, and of images of no case.
    """

    closed_days: int
    frames_days: int

    def closed_sentence(self) -> str:
        """The first rule, as it goes on record."""
        return f"cases that have been closed for {self.closed_days} days"

    def frames_sentence(self) -> str:
        """The second rule, as it goes on record."""
        return f"frames of fluoroscopy without a measurement, and images of no case, after {self.frames_days} days"


class Naming:
    """Which case's events name which hash; events of no case count as a case of their own."""

    def __init__(self) -> None:
        self._cases: dict[str, set[str | None]] = {}

    def see(self, case_id: str | None, data_json: str) -> None:
        """Take in an event."""
        for sha256 in hashes_in(data_json):
            self._cases.setdefault(sha256, set()).add(case_id)

    def only_named_by(self, case_id: str) -> frozenset[str]:
        """Hashes that the events of a case name and no other event does."""
        return frozenset(sha256 for sha256, cases in self._cases.items() if cases == {case_id})

    def forget(self, case_id: str) -> None:
        """The events of a case are gone."""
        for cases in self._cases.values():
            cases.discard(case_id)


def prunable_cases(cases: Iterable[Case], now_ns: int, rules: RetentionRules) -> tuple[Case, ...]:
    """Cases that are closed and have not changed for as long as the rule says."""
    latest_ns = now_ns - rules.closed_days * DAY_NS
    return tuple(case for case in cases if case.progress.closed and case.changed_at_ns < latest_ns)


@dataclass(slots=True)
class ImageUse:
    """What the log says of one image: when it was received last, and whether anything holds its file."""

    received_at_ns: int = 0
    is_single_shot: bool = False
    is_measured: bool = False
    is_in_open_case: bool = False


class ImageUses:
    """Uses of all images. A single shot of a case, and whatever was measured, is kept as long as its case."""

    def __init__(self, open_case_id: str | None) -> None:
        self._open_case_id = open_case_id
        self._uses: dict[str, ImageUse] = {}

    def receive(self, case_id: str | None, image: ImageReceived) -> None:
        """An image was received."""
        use = self._uses.setdefault(image.image_sha256, ImageUse())
        use.received_at_ns = max(use.received_at_ns, image.received_at_ns)
        use.is_single_shot |= case_id is not None and not image.in_run
        use.is_in_open_case |= case_id is not None and case_id == self._open_case_id

    def measure(self, data_json: str) -> None:
        """Another event names images."""
        for sha256 in hashes_in(data_json):
            self._uses.setdefault(sha256, ImageUse()).is_measured = True

    def prunable(self, now_ns: int, rules: RetentionRules) -> tuple[str, ...]:
        """Images whose files may go."""
        latest_ns = now_ns - rules.frames_days * DAY_NS
        return tuple(
            sha256
            for sha256, use in self._uses.items()
            if not (use.is_single_shot or use.is_measured or use.is_in_open_case) and 0 < use.received_at_ns < latest_ns
        )
