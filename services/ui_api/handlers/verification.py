"""Verifications: wires and guide holes against the nail's hole axes, measured by registration."""

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import VerificationMade, VerificationRefused
from services.ui_api.core.events import EventDraft
from services.ui_api.core.procedure_table import Action
from services.ui_api.handlers.procedure import ProcedureHandler
from services.ui_api.handlers.refusals import unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.messages.base import decode, encode
from shared.messages.registration import Verification, VerificationReply, VerificationRequest

# Chosen: wires in several images take seconds, on a busy machine several times that.
VERIFICATION_TIMEOUT_S = 60.0


class VerificationHandler:
    """Asks registration, and keeps what it answers."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord, procedure: ProcedureHandler) -> None:
        self._bus, self._keys, self._record, self._procedure = bus, keys, record, procedure

    def ask(self, case: Case, images: tuple[str, ...]) -> VerificationReply:
        """Have registration verify; raises `Refused` or `NoReply`. Records nothing."""
        self._procedure.require(case, Action.VERIFY)
        for image in images:
            if case.image(image) is None:
                raise unknown("image", image, f"GET /cases/{case.case_id}/images lists those of the case")
        request = VerificationRequest(case_id=case.case_id, image_sha256=images)
        answer = self._bus.query(self._keys.verification_request, encode(request), VERIFICATION_TIMEOUT_S)
        return decode(VerificationReply, answer.payload)

    def keep(self, unit: UnitOfWork, case_id: str, images: tuple[str, ...], reply: VerificationReply) -> int | None:
        """Record registration's answer; the verification's number, or None when there is none."""
        made = reply.verification
        if made is None:
            refusal = VerificationRefused(images, reply.code or "no_verification", reply.message)
            unit.append(EventDraft(refusal, case_id, "registration"))
            return None
        number = len(self._record.ledger.cases[case_id].verifications) + 1
        codes = tuple(reason.code.value for reason in made.reasons)
        data = VerificationMade(number, images, made.verdict, codes, unit.put_document(encode(made)))
        unit.append(EventDraft(data, case_id, "registration"))
        return number

    def content(self, case: Case, number: int) -> Verification:
        """A verification as registration made it; raises `Refused`."""
        if not 1 <= number <= len(case.verifications):
            raise unknown("verification", str(number), f"case {case.case_id} has {len(case.verifications)}")
        return decode(Verification, self._record.document(case.verifications[number - 1].document_sha256))
