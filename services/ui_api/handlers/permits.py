"""Permits to move: the gateway signs what the record says, and nothing while anything is in the guide or the bone."""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from services.ui_api.core.identity import Approver
from services.ui_api.core.inside import Inside, removing_step_of
from services.ui_api.core.procedure_conditions import IN_PLACE_CODES
from services.ui_api.handlers.refusals import conflict
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.messages.permits import Permit, SignedPermit
from shared.messages.robot import RobotState
from shared.pki.permit_key import PermitSigner


@dataclass(frozen=True, slots=True)
class ApprovedPlan:
    """What a move is permitted for; `approver` is the surgeon who approved exactly this plan."""

    sha256: str
    hole_ids: tuple[str, ...]
    approver: Approver


class PermitHandler:
    """Signs one permit for each command that moves the robot, and keeps its text in the record."""

    def __init__(self, record: CaseRecord, signer: PermitSigner) -> None:
        self._record, self._signer = record, signer

    def for_move(self, unit: UnitOfWork, state: RobotState, plan: ApprovedPlan) -> SignedPermit:
        """A permit for a move; raises `Refused` while anything is inside."""
        return self._sign(unit, state, plan, plan.approver)

    def for_reference(self, unit: UnitOfWork, state: RobotState, who: Approver) -> SignedPermit:
        """A permit for a reference; raises `Refused` while anything is inside."""
        return self._sign(unit, state, None, who)

    def _sign(self, unit: UnitOfWork, state: RobotState, plan: ApprovedPlan | None, approver: Approver) -> SignedPermit:
        inside = self._record.ledger.inside()
        require_nothing_inside(inside)
        case = self._record.ledger.open_case()
        permit = Permit(
            motion="reference" if plan is None else "move",
            plan_sha256=None if plan is None else plan.sha256,
            hole_ids=() if plan is None else plan.hole_ids,
            case_id=None if case is None else case.case_id,
            case_revision=0 if case is None else case.revision,
            robot_boot_epoch=state.boot_epoch,
            after_state_sequence=state.sequence,
            approver=approver.name,
            authenticated_by=approver.authenticated.value,
            hexapod_sha256=state.hexapod_sha256,
            nothing_inside=not inside,
            nonce=secrets.token_hex(16),
        )
        signed = self._signer.sign(permit)
        unit.put_document(signed.permit_json.encode())
        return signed


def require_nothing_inside(inside: Sequence[Inside]) -> None:
    """Refuse while a wire, a drill or a screw is in the guide or the bone."""
    if not inside:
        return
    kind = inside[0].kind
    holes = ", ".join(found.hole_id for found in inside if found.kind is kind)
    raise conflict(
        IN_PLACE_CODES[kind],
        f"{kind}s are in {holes}: the robot does not move before they are removed; take them out and record the step "
        f"'{removing_step_of(kind)}'",
    )
