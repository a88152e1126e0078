"""`If-Match`: whoever changes a case quotes it as it was read, and gets its newest state where somebody was faster.

The ETag of a case has two parts, `"<decided>-<content>"`. `decided` is the number of the last event by which somebody
has decided something; a change needs that part alone, for images arrive thirty times a second while fluoroscopy runs.
`content` is a hash of everything that the case says: `If-None-Match` needs both.
"""

import hashlib
import re
from typing import Annotated, Final

from fastapi import Header
from pydantic import BaseModel

from services.ui_api.core.case import Case
from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.record.unit_of_work import UnitOfWork
from services.ui_api.routes.views import CaseView
from services.ui_api.service import Gateway

# Of SHA-256; chosen: two contents differ in it but for chance, and nothing depends on more.
_HASH_CHARACTERS: Final = 16
# In place of a hash, in an ETag for `If-Match` alone: no content has it, so that `If-None-Match` never finds it.
_UNREAD: Final = "unread"
_CASE_ETAG: Final = r'"\d+-\w+"'
CaseMatch = Annotated[
    str,
    Header(
        alias="If-Match",
        max_length=80,
        description="ETag of the case as it was read: of GET /cases/{id}, or the newest Case-ETag of a change.",
    ),
]


def stale_precondition(code: str, message: str, current: BaseModel, etag: str) -> Refused:
    """Refusal because somebody was faster: it brings the newest state and its ETag."""
    refused = Refused(RefusalKind.PRECONDITION_FAILED, code, message)
    refused.current, refused.etag = current.model_dump(mode="json", by_alias=True), etag
    return refused


def case_view(gateway: Gateway, case: Case) -> CaseView:
    """A case as it is read."""
    return CaseView.of(case, gateway.procedure.situation(case))


def case_etag(gateway: Gateway, case: Case) -> str:
    """ETag of a case as it is."""
    content = case_view(gateway, case).model_dump_json().encode()
    return etag_of(gateway.record.ledger.decided(case.case_id), content_hash(content))


def case_etag_after(gateway: Gateway, case_id: str, unit: UnitOfWork) -> str:
    """What a further change of the case quotes, once the transaction is on the disk: it says nothing of the content."""
    return f'"{gateway.record.ledger.decided(case_id, unit.events)}-{_UNREAD}"'


def matched_case(gateway: Gateway, case_id: str, if_match: str) -> Case:
    """The case, if nobody has decided anything in it since it was read.

    Raises
    ------
    Refused
        When there is no such case, or it has changed: then with the newest state. Neither `*` nor a list will do,
        because a change is to the case that was read.
    """
    case = gateway.cases.case(case_id)
    if if_match.strip().partition("-")[0] != f'"{gateway.record.ledger.decided(case_id)}':
        etag = case_etag(gateway, case)
        raise stale_precondition("case_changed", _not_as_read(if_match, etag), case_view(gateway, case), etag)
    return case


def _not_as_read(if_match: str, etag: str) -> str:
    if not re.fullmatch(_CASE_ETAG, if_match.strip()):
        return (
            f"If-Match is {if_match}, which is no ETag of a case; send it as it was read, quotation marks too: {etag}"
        )
    return (
        f"If-Match is {if_match}, but the case is at {etag}: something was decided in it since; look at its newest "
        "state (`current`), and if the change is still wanted, send it with the newest ETag and a new key"
    )


def content_hash(content: bytes) -> str:
    """What an ETag says of a content."""
    return hashlib.sha256(content).hexdigest()[:_HASH_CHARACTERS]


def etag_of(decided: int, content_sha256: str) -> str:
    """A case's ETag from its two parts."""
    return f'"{decided}-{content_sha256}"'
