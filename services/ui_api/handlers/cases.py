"""Opening, changing and closing cases, and recording what people did with their hands."""

import secrets
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from services.ui_api.core.case import STEPS_THAT_CHANGE_THE_SETUP, Case
from services.ui_api.core.event_data import (
    CaseOpened,
    CaseSetup,
    PartUse,
    SetupChanged,
    Step,
    StepRecorded,
    StepWithdrawn,
)
from services.ui_api.core.events import EventDraft
from services.ui_api.core.procedure_table import Action, Verdict, decide_step
from services.ui_api.handlers.head_calibration import calibrated_hexapod, is_head_calibration
from services.ui_api.handlers.parts import JsonObject, PartFile, require_approved, resolve_part
from services.ui_api.handlers.procedure import ProcedureHandler, require_allowed
from services.ui_api.handlers.refusals import RefusalKind, Refused, conflict, invalid, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.parts.catalogue import PartKind


@dataclass(frozen=True, slots=True)
class SetupRequest:
    """What a client said of a set-up; None where it said nothing."""

    side: str | None
    bone: str | None
    mount: str | None
    head_extension_mm: float | None
    ring: str | JsonObject | None
    guide: str | JsonObject | None
    nail: str | JsonObject | None
    hexapod: str | JsonObject | None
    guide_calibration: JsonObject | None
    nominal_source_to_detector_mm: float | None
    nominal_pixel_mm: float | None
    drill_diameter_mm: float | None


@dataclass(frozen=True, slots=True)
class StepRequest:
    """A step that a client reports."""

    step: Step
    hole_ids: tuple[str, ...]
    who: str
    why: str


class CaseHandler:
    """Decides about cases within a unit of work.

    Parameters
    ----------
    announce
        Tells the bus afterwards.
    lack_of_space
        A sentence when the disks have no room for one more case.
    is_approved
        Whether the part file with this hash may be used.
    """

    def __init__(
        self,
        record: CaseRecord,
        announce: Callable[[], None],
        lack_of_space: Callable[[], str | None],
        is_approved: Callable[[str], bool],
        procedure: ProcedureHandler,
    ) -> None:
        self._record, self._procedure = record, procedure
        self._announce = announce
        self._lack_of_space = lack_of_space
        self._is_approved = is_approved

    def case(self, case_id: str) -> Case:
        """A case by its id; raises `Refused`."""
        case = self._record.ledger.cases.get(case_id)
        if case is None:
            raise unknown("case", case_id, "GET /cases lists them")
        return case

    def open_case(self, unit: UnitOfWork, request: SetupRequest, who: str) -> str:
        """Open a case and return its id; raises `Refused` or `PartFileInvalid`."""
        already = self._record.ledger.open_case()
        if already is not None:
            raise conflict(
                "case_already_open", f"case {already.case_id} is open in this room; finish or abandon it first"
            )
        if (lack := self._lack_of_space()) is not None:
            raise Refused(RefusalKind.UNAVAILABLE, "disk_fills", f"no new case is opened: {lack}")
        self._require_approved(request)
        setup = _new_setup(unit, request)
        case_id = f"case-{secrets.token_hex(5)}"
        unit.append(EventDraft(CaseOpened(setup), case_id, who))
        unit.after_commit(self._announce)
        return case_id

    def change_setup(self, unit: UnitOfWork, case_id: str, request: SetupRequest, who: str, why: str) -> None:
        """Change the set-up of an open case: its revision counts up, and older results become stale."""
        case = self.case(case_id)
        self._procedure.require(case, Action.CHANGE_SETUP)
        self._require_approved(request)
        setup = _changed_setup(unit, case.setup, request)
        if setup == case.setup:
            return
        unit.append(EventDraft(SetupChanged(case.revision + 1, setup), case_id, who, why))
        unit.after_commit(self._announce)

    def record_step(self, unit: UnitOfWork, case_id: str, request: StepRequest) -> None:
        """Record a step. One out of order needs a reason, because what was done is a fact all the same."""
        case = self.case(case_id)
        self._procedure.require(case, Action.RECORD_STEP)
        require_known_holes(request.hole_ids, case.holes_meant_by(request.step))
        decision = decide_step(self._procedure.situation(case), request.step)
        if not request.why:
            require_allowed(decision)
        out_of_order = decision.verdict is Verdict.WITH_REASON
        step = StepRecorded(request.step, request.hole_ids, out_of_order, request.why)
        unit.append(EventDraft(step, case_id, request.who, request.why))
        if request.step in STEPS_THAT_CHANGE_THE_SETUP:
            unit.append(EventDraft(SetupChanged(case.revision + 1, case.setup), case_id, request.who, request.step))
        unit.after_commit(self._announce)

    def withdraw_step(self, unit: UnitOfWork, case_id: str, number: int, who: str) -> None:
        """Take back the step that was recorded last, because it was not done; raises `Refused`."""
        case = self.case(case_id)
        self._procedure.require(case, Action.WITHDRAW_STEP)
        last = case.step_entries[-1]
        if number > last.number or number < 1:
            raise unknown("step", str(number), f"GET /cases/{case_id}/steps lists them")
        if number != last.number:
            raise conflict("step_not_undoable", f"step {number} is not the last; withdraw step {last.number} first")
        unit.append(EventDraft(StepWithdrawn(number, last.recorded.step), case_id, who))
        unit.after_commit(self._announce)

    def _require_approved(self, request: SetupRequest) -> None:
        given = {
            "ring": request.ring,
            "guide": request.guide,
            "nail": request.nail,
            "hexapod": request.hexapod,
            "guide calibration": request.guide_calibration,
        }
        for kind, part in given.items():
            if part is not None:
                require_approved(kind, part, self._is_approved)


def require_known_holes(hole_ids: Iterable[str], known: Collection[str]) -> None:
    """Refuse hole ids that are not among the known ones."""
    for hole_id in hole_ids:
        if hole_id not in known:
            raise invalid("unknown_hole", f"hole {hole_id!r} is not known; the case has {', '.join(known)}")


def _new_setup(unit: UnitOfWork, request: SetupRequest) -> CaseSetup:
    required: dict[str, object] = {
        "side": request.side,
        "bone": request.bone,
        "mount": request.mount,
        "nail": request.nail,
    }
    required |= {"guide": request.guide, "ring": request.ring, "head_extension_mm": request.head_extension_mm}
    missing = [name for name, value in required.items() if value is None]
    if missing:
        raise invalid("setup_incomplete", f"the set-up lacks {', '.join(missing)}")
    nothing = PartUse("", "")
    empty = CaseSetup("", "", "", 0.0, nothing, nothing, nothing, nothing)
    return _changed_setup(unit, empty, request)


def _changed_setup(unit: UnitOfWork, setup: CaseSetup, request: SetupRequest) -> CaseSetup:
    """The set-up with what the request says put in; new part files are validated, then stored."""
    given: Mapping[PartKind, str | JsonObject | None] = {
        "ring": request.ring,
        "guide": request.guide,
        "nail": request.nail,
        "hexapod": request.hexapod,
    }
    parts = {kind: resolve_part(kind, part) for kind, part in given.items() if part is not None}
    calibrated = setup.guide_calibrated and not _replaces_calibrated(setup, parts)
    if request.guide_calibration is not None:
        if is_head_calibration(request.guide_calibration):
            parts["hexapod"] = calibrated_hexapod(parts.get("hexapod"), request.guide_calibration)
        else:
            parts["guide"] = _calibrated_guide(parts.get("guide"), setup.guide, request.guide_calibration)
        calibrated = True
    for part in parts.values():
        unit.put_document(part.content)
    changed = replace(
        setup,
        side=request.side or setup.side,
        bone=request.bone or setup.bone,
        mount=request.mount or setup.mount,
        head_extension_mm=_first(request.head_extension_mm, setup.head_extension_mm),
        ring=parts["ring"].use if "ring" in parts else setup.ring,
        guide=parts["guide"].use if "guide" in parts else setup.guide,
        nail=parts["nail"].use if "nail" in parts else setup.nail,
        hexapod=parts["hexapod"].use if "hexapod" in parts else setup.hexapod,
        guide_calibrated=calibrated,
        nominal_source_to_detector_mm=request.nominal_source_to_detector_mm or setup.nominal_source_to_detector_mm,
        nominal_pixel_mm=request.nominal_pixel_mm or setup.nominal_pixel_mm,
        drill_diameter_mm=request.drill_diameter_mm or setup.drill_diameter_mm,
    )
    _require_holes_in_common(changed)
    _require_nail_of_bone(changed)
    return changed


def _replaces_calibrated(setup: CaseSetup, parts: Mapping[PartKind, PartFile]) -> bool:
    """Whether another guide or hexapod is given than the one in use: a calibration may have measured either."""
    in_use: Mapping[PartKind, PartUse] = {"guide": setup.guide, "hexapod": setup.hexapod}
    return any(kind in parts and parts[kind].use.sha256 != use.sha256 for kind, use in in_use.items())


def _first(given: float | None, otherwise: float) -> float:
    return otherwise if given is None else given


def _calibrated_guide(nominal: PartFile | None, in_use: PartUse, calibration: JsonObject) -> PartFile:
    """The guide as measured on its own: the same kind of file, with the same holes, in place of the nominal one."""
    measured = resolve_part("guide", calibration)
    nominal_use = nominal.use if nominal is not None else in_use
    if set(measured.use.hole_ids) != set(nominal_use.hole_ids):
        raise invalid(
            "guide_calibration_mismatch",
            f"the guide's calibration has holes {', '.join(measured.use.hole_ids)}, the guide '{nominal_use.name}' has "
            f"{', '.join(nominal_use.hole_ids)}; use the calibration of this guide",
        )
    return PartFile(replace(measured.use, name=nominal_use.name), measured.content)


def _require_holes_in_common(setup: CaseSetup) -> None:
    if not set(setup.nail.hole_ids) & set(setup.guide.hole_ids):
        raise invalid(
            "no_common_hole",
            f"nail '{setup.nail.name}' has holes {', '.join(setup.nail.hole_ids)}, guide '{setup.guide.name}' has "
            f"{', '.join(setup.guide.hole_ids)}: none in common; use parts whose hole ids belong together",
        )


def _require_nail_of_bone(setup: CaseSetup) -> None:
    if setup.nail.bone not in ("", setup.bone):
        raise invalid(
            "nail_of_other_bone",
            f"nail '{setup.nail.name}' is made for the {setup.nail.bone}, the case's bone is the {setup.bone}; correct "
            "the one that is wrong",
        )
