"""The situation of a case, from the record and the robot as last seen; and the refusals that the table states."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Final

from services.ui_api.core.case import Case, PlanEntry
from services.ui_api.core.event_data import LocalisationReceived
from services.ui_api.core.inside import Inside, ObjectKind
from services.ui_api.core.operations import VERBS_WITH_A_MOTION
from services.ui_api.core.procedure import Progress
from services.ui_api.core.procedure_conditions import Judge, Sort
from services.ui_api.core.procedure_table import Action, Decision, Verdict, decide
from services.ui_api.core.situation import (
    Basis,
    LastStep,
    Observed,
    Pending,
    PlanStanding,
    RobotCondition,
    Situation,
    condition_of,
)
from services.ui_api.handlers.refusals import RefusalKind, Refused
from services.ui_api.handlers.robot_view import RobotView, Validity
from services.ui_api.record.record import CaseRecord
from shared.errors import ReasonCode
from shared.messages.base import decode
from shared.messages.registration import Plan
from shared.parts.canonical import part_sha256

_KINDS: Final[Mapping[Sort, RefusalKind]] = {
    Sort.STATE: RefusalKind.CONFLICT,
    Sort.MISSING: RefusalKind.UNKNOWN,
    Sort.SILENCE: RefusalKind.UNAVAILABLE,
}
# Chosen: more plans than a case has; each is a string of a few bytes.
_EPOCHS_HELD: Final = 64
_HEXAPODS_HELD: Final = 16


class ProcedureHandler:
    """What may be done in a case now: one answer for its view and for every request."""

    def __init__(self, record: CaseRecord, view: RobotView) -> None:
        self._record, self._view = record, view
        self._epochs: dict[str, str] = {}
        self._hexapods: dict[str, str] = {}

    def require(self, case: Case, action: Action) -> None:
        """Raise `Refused` where the table refuses; what only the robot refuses is let pass, for it may know better."""
        require_allowed(decide(self.situation(case), action))

    def require_of_robot(self, action: Action) -> None:
        """The same for an action that needs no case."""
        require_allowed(decide(self.robot_situation(), action))

    def situation(self, case: Case) -> Situation:
        """All that decides what may be done in a case."""
        newest = case.newest_localisation()
        basis, plan = _basis(case, newest), self._standing(case)
        robot = self.robot_situation()
        inside = case.progress.inside
        screwed = {found.hole_id for found in inside if found.kind is ObjectKind.SCREW}
        return Situation(
            progress=case.progress,
            basis=basis,
            plan=plan,
            pending=robot.pending,
            robot=robot.robot,
            has_images=bool(case.images),
            guide_seen=newest is None or ReasonCode.GUIDE_NOT_FOUND not in newest.reason_codes,
            some_drilled=bool(case.drilled_hole_ids),
            all_screwed=screwed >= set(case.hole_ids),
            last_step=_last_step(case),
            side_agrees=case.side_of_images in (None, case.setup.side),
            hexapod_agrees=self._robot_hexapod() in (None, self._case_hexapod(case)),
            observed=Observed({**robot.observed.values, **self._quoted(case, newest)}),
        )

    def robot_situation(self) -> Situation:
        """The same for the robot's own actions, which need no case; what is left inside counts all the same."""
        pending, operation = self._pending()
        inside = self._record.ledger.inside()
        return Situation(
            progress=Progress(inside=frozenset(inside)),
            pending=pending,
            robot=self._condition(),
            observed=Observed({"operation": operation, **_held(inside), **self._robot_quoted()}),
        )

    def version(self) -> Hashable | None:
        """Equal for as long as every situation stays as it is; None while each reading differs, as a quoted age does.

        Ask before what is kept under it is made: the record may grow meanwhile.
        """
        head, seen, validity = self._record.ledger.head_sequence, self._view.newest(), self._view.validity()
        if validity is Validity.STALE:
            return None
        if seen is None:
            return head, validity
        state = seen.state
        return head, validity, state.boot_epoch, state.state, state.stop, state.stop_button

    def staleness_of(self, case: Case, entry: PlanEntry, plan: Plan | None = None) -> str | None:
        """Why a plan no longer holds, as a clause; None when it does hold. One that is not on record yet is given."""
        if entry.used:
            return "a motion was made from it"
        made_after = case.plans[entry.made.number :]
        if made_after:
            return f"plan {made_after[-1].made.number} was made after it"
        seen = self._view.newest()
        epoch = self._robot_epoch(entry.made.plan_sha256) if plan is None else plan.robot_boot_epoch
        if seen is not None and seen.state.boot_epoch != epoch:
            return "the robot service restarted since"
        return case.staleness_of_image(entry.made.image_sha256, entry.made.case_revision)

    def is_at_hand(self, case: Case) -> bool:
        """Whether the situation of a case can be told without asking the database."""
        known = not case.plans or case.plans[-1].made.plan_sha256 in self._epochs
        kept_as = case.setup.hexapod.sha256
        return known and (self._robot_hexapod() in (None, kept_as) or kept_as in self._hexapods)

    def _robot_epoch(self, plan_sha256: str) -> str:
        """Run of the robot service that a plan is for; a plan does not change, and views are read often."""
        known = self._epochs.get(plan_sha256)
        if known is None:
            known = decode(Plan, self._record.document(plan_sha256)).robot_boot_epoch
            self._epochs = {**dict(list(self._epochs.items())[1 - _EPOCHS_HELD :]), plan_sha256: known}
        return known

    def _robot_hexapod(self) -> str | None:
        """Hash of the hexapod that the robot was started with; None while nothing was heard of it."""
        seen = self._view.newest()
        return None if seen is None else seen.state.hexapod_sha256

    def _case_hexapod(self, case: Case) -> str:
        """Hash of the case's hexapod: in records of older versions a part's file lies under another hash than its."""
        kept_as = case.setup.hexapod.sha256
        if self._robot_hexapod() in (None, kept_as):
            return kept_as
        known = self._hexapods.get(kept_as)
        if known is None:
            try:
                known = part_sha256(self._record.document(kept_as), f"hexapod '{case.setup.hexapod.name}'")
            except KeyError:  # of a set-up that is being recorded now
                return kept_as
            self._hexapods = {**dict(list(self._hexapods.items())[1 - _HEXAPODS_HELD :]), kept_as: known}
        return known

    def _standing(self, case: Case) -> PlanStanding:
        if not case.plans:
            return PlanStanding.NONE
        entry = case.plans[-1]
        if case.progress.closed or self.staleness_of(case, entry) is not None:
            return PlanStanding.STALE
        if entry.approval is None:
            return PlanStanding.MADE
        unsigned = entry.approval.authenticated_by is None
        return PlanStanding.APPROVED_BEFORE_USERS if unsigned else PlanStanding.APPROVED

    def _condition(self) -> RobotCondition:
        seen = self._view.newest()
        match self._view.validity():
            case Validity.CURRENT if seen is not None:
                return condition_of(seen.state.state, seen.state.stop, seen.state.stop_button)
            case Validity.STALE:
                return RobotCondition.STALE
            case _:
                return RobotCondition.ABSENT

    def _pending(self) -> tuple[Pending, str]:
        for operation in self._record.ledger.pending_operations():
            verb = operation.requested.verb
            if verb in VERBS_WITH_A_MOTION:
                sentence = f"operation {operation.requested.operation_id} ({verb}) is {operation.status}"
                return (Pending.MOVE if verb == "move" else Pending.REFERENCE), sentence
        return Pending.NOTHING, "the operation is about to end"

    def _robot_quoted(self) -> dict[str, str]:
        seen, age_s = self._view.newest(), self._view.age_s()
        quoted = {"robot_age_limit": f"{self._view.stale_after_s:g} s"}
        if seen is not None and age_s is not None:
            quoted["robot_state"] = seen.state.state
            if self._view.validity() is Validity.STALE:  # else nothing quotes it, and each reading would differ
                quoted["robot_age"] = f"{age_s:.1f} s"
        return quoted

    def _quoted(self, case: Case, newest: LocalisationReceived | None) -> dict[str, str]:
        quoted = {"case": case.case_id, "stage": str(case.progress.stage), **_held(tuple(sorted(case.progress.inside)))}
        quoted |= {
            "hexapod": case.setup.hexapod.name,
            "case_hexapod": self._case_hexapod(case)[:12],
            "robot_hexapod": (self._robot_hexapod() or "not known")[:12],
        }
        quoted |= {"side": case.setup.side, "image_side": case.side_of_images or "same"}
        if case.step_entries:
            last = case.step_entries[-1]
            quoted |= {"step": str(last.number), "step_name": last.recorded.step}
        if newest is not None:
            stale = localisation_staleness(case, newest)
            quoted |= {"localisation": str(newest.number), "reasons": ", ".join(newest.reason_codes) or "no reason"}
            quoted |= {} if stale is None else {"localisation_stale_because": stale}
        if case.verifications and case.verifications[-1].passing_hole_ids:
            left = [one for one in case.verifications[-1].passing_hole_ids if one not in case.drilled_hole_ids]
            quoted["verified_holes"] = ", ".join(left) or "no other was verified"
        if case.plans:
            entry = case.plans[-1]
            quoted["plan"] = str(entry.made.number)
            quoted["approver"] = "nobody" if entry.approval is None else entry.approval.approved_by
            stale = "the case is closed" if case.progress.closed else self.staleness_of(case, entry)
            quoted |= {} if stale is None else {"plan_stale_because": stale}
        return quoted


def require_allowed(decision: Decision) -> None:
    """Raise `Refused` for what the gateway refuses."""
    if decision.verdict is not Verdict.ALLOWED and decision.judge is Judge.GATEWAY:
        raise Refused(_KINDS[decision.sort], decision.code, decision.message)


def localisation_staleness(case: Case, measured: LocalisationReceived) -> str | None:
    """Why a localisation no longer holds, as a clause; None when it does hold."""
    newest = case.newest_localisation()
    if newest is not None and newest.number != measured.number:
        return f"localisation {newest.number} is newer"
    return case.staleness_of_image(measured.image_sha256, measured.case_revision)


def _last_step(case: Case) -> LastStep:
    if not case.step_entries:
        return LastStep.NONE
    safe = case.step_entries[-1].is_undone_safely(case.progress)
    return LastStep.CAN_BE_UNDONE if safe else LastStep.CANNOT_BE_UNDONE


def _basis(case: Case, newest: LocalisationReceived | None) -> Basis:
    if newest is None:
        return Basis.NOTHING
    if localisation_staleness(case, newest) is not None:
        return Basis.STALE
    if newest.verdict == "accepted":
        return Basis.ACCEPTED
    others = any(x.case_revision == case.revision and x.number != newest.number for x in case.localisations)
    return Basis.SEVERAL if others or case.verifications else Basis.REJECTED


def _held(inside: Sequence[Inside]) -> dict[str, str]:
    """Holes in which something is, by its kind."""
    return {
        f"{kind}_holes": ", ".join(found.hole_id for found in inside if found.kind is kind)
        for kind in ObjectKind
        if any(found.kind is kind for found in inside)
    }
