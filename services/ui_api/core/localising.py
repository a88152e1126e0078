"""The way of an image to its localisation, as something that can be followed like an operation. Pure.

Nobody asks for it: the C-arm takes an image, imaging calibrates it, registration localises it. So it has no events of
its own; it is what the case's events say of the image.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from services.ui_api.core.case import Case
from services.ui_api.core.computation_event_data import ComputationStatus
from services.ui_api.core.computations import STEPS
from services.ui_api.core.event_data import ImageReceived, ImageSkipped, LocalisationReceived

# Of its id: the image's own follows.
PREFIX: Final = "localise-"
VERB: Final = "localise"
_SUPERSEDED: Final = "superseded"
_WAYS: Final = ("imaging calibrates the image", "registration localises nail and guide in it")


@dataclass(frozen=True, slots=True)
class Localising:
    """How far an image has come.

    Attributes
    ----------
    step, says
        Which of three steps, and what is done in it.
    result
        Path of the localisation, accepted or rejected.
    """

    image: ImageReceived
    case_id: str
    status: ComputationStatus
    step: int
    says: str
    code: str = ""
    message: str = ""
    result: str | None = None
    ended_at_ns: int | None = None

    @property
    def operation_id(self) -> str:
        """Its id among the operations."""
        return f"{PREFIX}{self.image.image_sha256}"

    @property
    def requested_at_ns(self) -> int:
        """When the image came."""
        return self.image.received_at_ns

    @property
    def ended(self) -> bool:
        """Whether nothing more will come of it."""
        return self.status is not ComputationStatus.RUNNING


@dataclass(frozen=True, slots=True)
class _Reports:
    """What a case's events say of its images, by hash: of each the newest, and when it was said."""

    case: Case
    calibrated: frozenset[str]
    localised: Mapping[str, tuple[LocalisationReceived, int]]
    skipped: Mapping[str, tuple[ImageSkipped, int]]

    @staticmethod
    def of(case: Case) -> "_Reports":
        """Gather them once for all images of a case."""
        return _Reports(
            case,
            frozenset(one.image_sha256 for one in case.calibrations),
            {one.image_sha256: (one, at) for one, at in zip(case.localisations, case.localised_at_ns, strict=True)},
            {one.image_sha256: (one, at) for one, at in zip(case.skipped, case.skipped_at_ns, strict=True)},
        )


def localising_of(case: Case, image: ImageReceived) -> Localising | None:
    """The way of one image; None of a frame of fluoroscopy that nobody localises."""
    return _way(_Reports.of(case), image)


def operation_id_of(case: Case, image: ImageReceived) -> str | None:
    """Id of an image's way among the operations; None of a frame of fluoroscopy that nobody localises."""
    sha256 = image.image_sha256
    has_ended = case.localisation_of(sha256) is not None or case.skip_of(sha256) is not None
    return f"{PREFIX}{sha256}" if has_ended or _is_waited_for(case, image) else None


def localisings_of(case: Case) -> Iterator[Localising]:
    """The ways of all images of a case, in their order."""
    reports = _Reports.of(case)
    for image in case.images:
        found = _way(reports, image)
        if found is not None:
            yield found


def _way(reports: _Reports, image: ImageReceived) -> Localising | None:
    case = reports.case
    ended = _localised(reports, image) or _skipped(reports, image)
    if ended is not None or not _is_waited_for(case, image):
        return ended
    if case.progress.closed or (image.sequence is None and not _is_newest(case, image)):
        gone_on = "the case went on without it"
        return _ended(case, image, ComputationStatus.CANCELLED, _SUPERSEDED, gone_on, case.changed_at_ns)
    step = 2 if image.image_sha256 in reports.calibrated else 1
    return Localising(image, case.case_id, ComputationStatus.RUNNING, step, _WAYS[step - 1])


def _is_waited_for(case: Case, image: ImageReceived) -> bool:
    return not image.in_run or _is_newest(case, image)


def _is_newest(case: Case, image: ImageReceived) -> bool:
    return case.images[-1].image_sha256 == image.image_sha256


def _localised(reports: _Reports, image: ImageReceived) -> Localising | None:
    if image.image_sha256 not in reports.localised:
        return None
    measured, at_ns = reports.localised[image.image_sha256]
    why = f": {', '.join(measured.reason_codes)}" if measured.reason_codes else ""
    said = f"it was {measured.verdict}{why}"
    done = _ended(reports.case, image, ComputationStatus.SUCCEEDED, "", said, at_ns)
    return replace(done, result=f"/api/v1/cases/{reports.case.case_id}/localisations/{measured.number}")


def _skipped(reports: _Reports, image: ImageReceived) -> Localising | None:
    if image.image_sha256 not in reports.skipped:
        return None
    skip, at_ns = reports.skipped[image.image_sha256]
    status = ComputationStatus.CANCELLED if skip.code == _SUPERSEDED else ComputationStatus.FAILED
    return _ended(reports.case, image, status, skip.code, skip.message, at_ns)


def _ended(
    case: Case, image: ImageReceived, status: ComputationStatus, code: str, message: str, at_ns: int
) -> Localising:
    return Localising(image, case.case_id, status, STEPS, message, code, message, ended_at_ns=at_ns)
