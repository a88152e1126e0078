"""The way of an image to its localisation, as something that can be followed like an operation. Pure.

Nobody asks for it: the C-arm takes an image, imaging calibrates it, registration localises it. So it has no events of
its own; it is what the case's events say of the image.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from services.ui_api.core.case import Case
from services.ui_api.core.computation_event_data import ComputationStatus
from services.ui_api.core.computations import STEPS
from services.ui_api.core.event_data import ImageReceived

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


def localising_of(case: Case, image: ImageReceived) -> Localising | None:
    """The way of one image; None of a frame of fluoroscopy that nobody localises."""
    ended = _localised(case, image) or _skipped(case, image)
    is_newest = case.images[-1].image_sha256 == image.image_sha256
    if ended is not None or (image.in_run and not is_newest):
        return ended
    if case.progress.closed or (image.sequence is None and not is_newest):
        gone_on = "the case went on without it"
        return _ended(case, image, ComputationStatus.CANCELLED, _SUPERSEDED, gone_on, case.changed_at_ns)
    step = 1 if case.calibration_of(image.image_sha256) is None else 2
    return Localising(image, case.case_id, ComputationStatus.RUNNING, step, _WAYS[step - 1])


def _localised(case: Case, image: ImageReceived) -> Localising | None:
    measured = case.localisation_of(image.image_sha256)
    if measured is None:
        return None
    why = f": {', '.join(measured.reason_codes)}" if measured.reason_codes else ""
    at_ns = case.localised_at_ns[measured.number - 1]
    done = _ended(case, image, ComputationStatus.SUCCEEDED, "", f"it was {measured.verdict}{why}", at_ns)
    return replace(done, result=f"/api/v1/cases/{case.case_id}/localisations/{measured.number}")


def _skipped(case: Case, image: ImageReceived) -> Localising | None:
    skip = case.skip_of(image.image_sha256)
    if skip is None:
        return None
    status = ComputationStatus.CANCELLED if skip.code == _SUPERSEDED else ComputationStatus.FAILED
    return _ended(case, image, status, skip.code, skip.message, case.skipped_at_ns[case.skipped.index(skip)])


def _ended(
    case: Case, image: ImageReceived, status: ComputationStatus, code: str, message: str, at_ns: int
) -> Localising:
    return Localising(image, case.case_id, status, STEPS, message, code, message, ended_at_ns=at_ns)


def localisings_of(case: Case) -> Iterator[Localising]:
    """The ways of all images of a case, in their order."""
    for image in case.images:
        found = localising_of(case, image)
        if found is not None:
            yield found
