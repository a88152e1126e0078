"""What consoles read again and again, kept until something that it shows has changed: a case, and the robot's actions.

A view depends on values that never change, the case and its situation: it is the same as long as they are.
"""

from collections import OrderedDict
from dataclasses import dataclass
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
    case: Case
    situation: Situation
    content: bytes
    content_sha256: str


class KeptViews:
    """Reads cases and actions. Any thread may ask: at worst, two make the same view."""

    def __init__(self) -> None:
        self._cases: OrderedDict[str, _Kept] = OrderedDict()
        self._actions: tuple[Situation, list[ActionView]] | None = None

    def case(self, gateway: Gateway, case: Case) -> CaseAnswer:
        """A case with its ETag."""
        decided = gateway.record.ledger.decided(case.case_id)
        situation = gateway.procedure.situation(case)
        kept = self._cases.get(case.case_id)
        if kept is None or kept.case is not case or kept.situation != situation:
            kept = _made(case, situation)
            self._cases[case.case_id] = kept
            while len(self._cases) > _CASES_KEPT:
                self._cases.popitem(last=False)
        return CaseAnswer(kept.content, etag_of(decided, kept.content_sha256))

    def robot_actions(self, gateway: Gateway) -> list[ActionView]:
        """The actions that need no case."""
        situation, kept = gateway.procedure.robot_situation(), self._actions
        if kept is None or kept[0] != situation:
            self._actions = kept = (situation, robot_action_views(situation))
        return kept[1]


def _made(case: Case, situation: Situation) -> _Kept:
    content = CaseView.of(case, situation).model_dump_json().encode()
    return _Kept(case, situation, content, content_hash(content))
