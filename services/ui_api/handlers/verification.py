"""Verifications: wires and guide holes against the nail's hole axes, measured by registration."""

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import VerificationMade, VerificationRefused
from services.ui_api.core.events import EventDraft
from services.ui_api.core.procedure_table import Action
from services.ui_api.handlers.procedure import ProcedureHandler
from services.ui_api.handlers.refusals import Refused, conflict, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.equipment import LEAST_CHANCE_TO_PASS
from shared.messages.base import decode, encode
from shared.messages.registration import (
    Verification,
    VerificationOf,
    VerificationReply,
    VerificationRequest,
    VerifiedGuideHole,
    VerifiedWire,
)

# Chosen: wires in several images take seconds, on a busy machine several times that.
VERIFICATION_TIMEOUT_S = 60.0


class VerificationHandler:
    """Asks registration, and keeps what it answers."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord, procedure: ProcedureHandler) -> None:
        self._bus, self._keys, self._record, self._procedure = bus, keys, record, procedure

    def request(self, case: Case, images: tuple[str, ...], of: VerificationOf = "wires") -> VerificationRequest:
        """What to ask registration; raises `Refused` where that cannot be verified now."""
        self._procedure.require(case, Action.VERIFY)
        for image in images:
            if case.image(image) is None:
                raise unknown("image", image, f"GET /cases/{case.case_id}/images lists those of the case")
        if (stale := _stale(case, images)) is not None:
            raise stale
        return VerificationRequest(case_id=case.case_id, image_sha256=images, of=of)

    def ask(self, request: VerificationRequest) -> VerificationReply:
        """Have registration verify; raises `NoReply`. Records nothing."""
        answer = self._bus.query(self._keys.verification_request, encode(request), VERIFICATION_TIMEOUT_S)
        return decode(VerificationReply, answer.payload)

    def keep(
        self, unit: UnitOfWork, case_id: str, images: tuple[str, ...], reply: VerificationReply
    ) -> int | VerificationRefused:
        """Record registration's answer; the verification's number, or why there is none.

        The guide may have moved while registration compared: then the answer is of where it was, and does not count.
        """
        case, made = self._record.ledger.cases[case_id], reply.verification
        stale = _stale(case, images)
        if made is None or stale is not None:
            by_registration = (reply.code or "no_verification", reply.message)
            refusal = VerificationRefused(images, *(by_registration if stale is None else (stale.code, str(stale))))
            unit.append(EventDraft(refusal, case_id, "registration" if stale is None else "gateway"))
            return refusal
        number = len(case.verifications) + 1
        codes = tuple(reason.code.value for reason in made.reasons)
        passing = tuple(one.id for one in _measured(made) if one.chance_to_pass >= LEAST_CHANCE_TO_PASS)
        data = VerificationMade(number, images, made.verdict, codes, unit.put_document(encode(made)), passing)
        unit.append(EventDraft(data, case_id, "registration"))
        return number

    def content(self, case: Case, number: int) -> Verification:
        """A verification as registration made it; raises `Refused`."""
        if not 1 <= number <= len(case.verifications):
            raise unknown("verification", str(number), f"case {case.case_id} has {len(case.verifications)}")
        return decode(Verification, self._record.document(case.verifications[number - 1].document_sha256))


def _stale(case: Case, images: tuple[str, ...]) -> Refused | None:
    """Refusal because an image does not show where the guide is; None when all do."""
    for image in images:
        because = case.guide_moved_since(image)
        if because is not None:
            what = f"image {image[:12]} no longer shows where the guide is"
            return conflict("image_stale", f"{what}: {because}; take an image and verify that one")
    return None


def _measured(made: Verification) -> tuple[VerifiedWire, ...] | tuple[VerifiedGuideHole, ...]:
    """What a drill is to follow: wires where they were to be verified, else the guide's own holes."""
    return made.guide_holes if made.of == "guide" else made.wires
