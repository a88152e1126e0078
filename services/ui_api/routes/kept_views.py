"""What consoles read again and again, kept until something that it shows has changed: a case, and the robot's actions.

A view depends on values that never change, the case and its situation: it is the same as long as they are. They are not
even looked at while the record has not grown and the robot's condition is as it was (`ProcedureHandler.version`).
"""

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Final

from services.ui_api.core.case import Case
from services.ui_api.core.situation import Situation
from services.ui_api.routes.preconditions import content_hash, etag_of
from services.ui_api.routes.procedure_views import ActionView, robot_action_views
from services.ui_api.routes.views import CaseView
from services.ui_api.service import Gateway

# Chosen: the open case, and some that somebody looks up meanwhile; each is some kB.
_CASES_KEPT: Final = 16


@dataclass(frozen=True, slots=True)
class CaseAnswer:
    """A case as it is sent."""

    content: bytes
    etag: str


@dataclass(frozen=True, slots=True)
class _Kept:
    version: Hashable
    case: Case
    situation: Situation
    content: bytes
    content_sha256: str


class KeptViews:
    """Reads cases and actions. Any thread may ask: at worst, two make the same view."""

    def __init__(self) -> None:
        self._cases: OrderedDict[str, _Kept] = OrderedDict()
        self._actions: tuple[Hashable, Situation, list[ActionView]] | None = None

    def case(self, gateway: Gateway, case: Case) -> CaseAnswer:
        """A case with its ETag."""
        decided, version = gateway.record.ledger.decided(case.case_id), gateway.procedure.version()
        kept = self._cases.get(case.case_id)
        if kept is None or kept.case is not case or version is None or kept.version != version:
            kept = self._cases[case.case_id] = _made(kept, version, case, gateway.procedure.situation(case))
            while len(self._cases) > _CASES_KEPT:
                self._cases.popitem(last=False)
        return CaseAnswer(kept.content, etag_of(decided, kept.content_sha256))

    def robot_actions(self, gateway: Gateway) -> list[ActionView]:
        """The actions that need no case."""
        version, kept = gateway.procedure.version(), self._actions
        if kept is None or version is None or kept[0] != version:
            situation = gateway.procedure.robot_situation()
            same = kept is not None and kept[1] == situation
            kept = (version, situation, kept[2] if kept and same else robot_action_views(situation))
            self._actions = kept
        return kept[2]


def _made(kept: _Kept | None, version: Hashable, case: Case, situation: Situation) -> _Kept:
    """A view to keep; the one that was kept where it shows the same."""
    if kept is not None and kept.case is case and kept.situation == situation:
        return replace(kept, version=version)
    content = CaseView.of(case, situation).model_dump_json().encode()
    return _Kept(version, case, situation, content, content_hash(content))
