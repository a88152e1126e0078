"""Quality reports over the images of a case, made by imaging."""

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import QaReported
from services.ui_api.core.events import EventDraft
from services.ui_api.handlers.refusals import conflict, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.messages.base import decode, encode
from shared.messages.qa import QaReply, QaReport, QaRequest

# A third of a second an image, thirty-two of them, on a machine that has other things to do as well.
QA_TIMEOUT_S = 60.0


class QualityHandler:
    """Asks imaging, and keeps what it answers."""

    def __init__(self, bus: Bus, keys: Keys, record: CaseRecord) -> None:
        self._bus, self._keys, self._record = bus, keys, record

    def request(self, case: Case, images: tuple[str, ...]) -> QaRequest:
        """What to ask imaging; raises `Refused` where there can be no report."""
        if case.progress.closed:
            raise conflict("case_closed", f"case {case.case_id} is {case.progress.stage}: it takes no quality report")
        for image in images:
            if case.image(image) is None:
                raise unknown("image", image, f"GET /cases/{case.case_id}/images lists those of the case")
        return QaRequest(case_id=case.case_id, image_sha256=images)

    def ask(self, request: QaRequest) -> QaReply:
        """Have imaging examine images; raises `NoReply`. Records nothing."""
        return decode(QaReply, self._bus.query(self._keys.qa_request, encode(request), QA_TIMEOUT_S).payload)

    def keep(self, unit: UnitOfWork, case_id: str, images: tuple[str, ...], report: QaReport, page: str) -> int:
        """Record a report; its number."""
        number = len(self._record.ledger.cases[case_id].qa_reports) + 1
        document, shown = unit.put_document(encode(report)), unit.put_document(page.encode())
        unit.append(EventDraft(QaReported(number, images, report.verdict, document, shown), case_id, "imaging"))
        return number

    def content(self, case: Case, number: int) -> QaReport:
        """A report as imaging made it; raises `Refused`."""
        return decode(QaReport, self._record.document(_entry(case, number).document_sha256))

    def page(self, case: Case, number: int) -> bytes:
        """Its page for people; raises `Refused`."""
        return self._record.document(_entry(case, number).page_sha256)


def _entry(case: Case, number: int) -> QaReported:
    if not 1 <= number <= len(case.qa_reports):
        raise unknown("qa_report", str(number), f"case {case.case_id} has {len(case.qa_reports)}")
    return case.qa_reports[number - 1]
