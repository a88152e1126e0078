"""What to do next, in one sentence that is right in every situation, and in which phase of the procedure that is. Pure.

The rows are tried in order, the first that fits is it. A test goes through every situation: what a row says can be done
is what the table allows.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import REMOVING_STEPS, ObjectKind
from services.ui_api.core.procedure import Stage
from services.ui_api.core.procedure_table import Action
from services.ui_api.core.situation import Basis, Pending, PlanStanding, RobotCondition, Situation


class Phase(StrEnum):
    """Phases of the procedure, in the order of the protocol."""

    SET_UP = "set_up"
    MOUNTING = "mounting"
    ALIGNMENT = "alignment"
    LOCALISATION = "localisation"
    PLAN = "plan"
    APPROVAL = "approval"
    MOTION = "motion"
    LOCKED = "locked"
    WIRES = "wires"
    VERIFICATION = "verification"
    DRILLING = "drilling"
    ROBOT_OFF = "robot_off"
    SCREWS = "screws"
    CLOSED = "closed"


class PhaseStatus(StrEnum):
    """Where a phase stands on the line of a case."""

    DONE = "done"
    NOW = "now"
    TO_COME = "to_come"


# What a case goes through when all goes well; other phases are detours, which lead back to the named one.
_LINE: Final[tuple[Phase, ...]] = tuple(phase for phase in Phase if phase not in (Phase.MOUNTING, Phase.WIRES))
_DETOURS: Final[Mapping[Phase, Phase]] = {Phase.MOUNTING: Phase.ALIGNMENT, Phase.WIRES: Phase.VERIFICATION}


def phase_line(now: Phase) -> tuple[tuple[Phase, PhaseStatus], ...]:
    """The line of phases, as it is shown: each with what it is in the present phase, detours only while they last."""
    line = [*_LINE]
    if now in _DETOURS:
        line.insert(line.index(_DETOURS[now]), now)
    here = line.index(now)
    return tuple(
        (phase, PhaseStatus.NOW if i == here else PhaseStatus.DONE if i < here else PhaseStatus.TO_COME)
        for i, phase in enumerate(line)
    )


@dataclass(frozen=True, slots=True)
class NextStep:
    """One row.

    Attributes
    ----------
    does
        The action or step that it asks for; None where there is only to wait, or to see to something outside.
    """

    phase: Phase
    fits: Callable[[Situation], bool]
    does: Action | Step | None
    sentence: str


def _at(stage: Stage) -> Callable[[Situation], bool]:
    return lambda s: s.progress.stage is stage


def _inside(stage: Stage, kind: ObjectKind) -> Callable[[Situation], bool]:
    return lambda s: s.progress.stage is stage and kind in s.kinds_inside


def _unsupervised(stage: Stage) -> Callable[[Situation], bool]:
    return lambda s: s.progress.stage is stage and s.robot in (*_SILENT, RobotCondition.DISCONNECTED)


def _before_motion(s: Situation) -> bool:
    """Whether the robot is to move next: to begin with, or by a plan that is made or approved."""
    planned = s.plan in (PlanStanding.MADE, PlanStanding.APPROVED) and not s.kinds_inside
    return s.progress.stage is Stage.POSITIONING or (s.progress.stage in (Stage.ALIGNED, Stage.VERIFIED) and planned)


def _robot(*conditions: RobotCondition) -> Callable[[Situation], bool]:
    return lambda s: _before_motion(s) and s.robot in conditions


def _plan(*standings: PlanStanding) -> Callable[[Situation], bool]:
    return lambda s: _before_motion(s) and s.plan in standings


def _close_to_motion(s: Situation) -> bool:
    """Whether a plan can be requested, or there is one."""
    planned = s.plan in (PlanStanding.MADE, PlanStanding.APPROVED)
    return _before_motion(s) and (planned or (s.progress.stage is Stage.POSITIONING and s.basis is Basis.ACCEPTED))


def _basis(*found: Basis) -> Callable[[Situation], bool]:
    return lambda s: s.progress.stage is Stage.POSITIONING and s.basis in found


def _being_localised(s: Situation) -> bool:
    """Whether the guide is in place and the newest image, taken there, has no localisation yet."""
    return s.progress.stage is Stage.ALIGNED and s.progress.seen and s.basis in (Basis.NOTHING, Basis.STALE)


_OUT = "{held}s are in the guide or the bone: take them out and record it, because the robot does not move before."
_PHASE_AT_REST: Final[Mapping[Stage, Phase]] = {
    Stage.POSITIONING: Phase.SET_UP,
    Stage.ALIGNED: Phase.LOCKED,
    Stage.VERIFIED: Phase.DRILLING,
}
# Rows of their own say what these are for.
_HELD_ON_PURPOSE: Final = (
    (Stage.ALIGNED, ObjectKind.WIRE),
    (Stage.VERIFIED, ObjectKind.WIRE),
    (Stage.VERIFIED, ObjectKind.DRILL),
)
_SILENT = (RobotCondition.ABSENT, RobotCondition.STALE)

_WHILE_MOVING: Final = (
    NextStep(Phase.CLOSED, _at(Stage.FINISHED), None, "The case is finished."),
    NextStep(Phase.CLOSED, _at(Stage.ABANDONED), None, "The case was abandoned."),
    NextStep(
        Phase.MOTION,
        lambda s: (s.progress.stage is Stage.MOVING or s.pending is not Pending.NOTHING) and s.robot in _SILENT,
        Action.STOP,
        "The robot is silent while it may be moving: stop it, and press the stop button on its controller.",
    ),
    NextStep(
        Phase.MOTION,
        lambda s: s.progress.stage is Stage.MOVING or s.pending is Pending.MOVE,
        Action.STOP,
        "Wait until the robot has reached its target and is locked, or stop it.",
    ),
    NextStep(
        Phase.SET_UP,
        lambda s: s.pending is Pending.REFERENCE,
        Action.STOP,
        "Wait until the reference has ended, or stop it.",
    ),
)
_AFTER_DRILLING: Final = (
    NextStep(
        Phase.SCREWS,
        _inside(Stage.ROBOT_REMOVED, ObjectKind.WIRE),
        Step.WIRES_REMOVED,
        "Take the wires out of the bone and record it.",
    ),
    NextStep(
        Phase.SCREWS,
        _inside(Stage.ROBOT_REMOVED, ObjectKind.DRILL),
        Step.DRILL_REMOVED,
        "Take the drill out of the bone and record it.",
    ),
    NextStep(
        Phase.SCREWS,
        lambda s: s.progress.stage is Stage.ROBOT_REMOVED and s.some_drilled and not s.all_screwed,
        Step.SCREWS_INSERTED,
        "Insert the screws and record it; then finish the case.",
    ),
    NextStep(Phase.SCREWS, _at(Stage.ROBOT_REMOVED), Step.FINISHED, "Finish the case."),
    NextStep(
        Phase.DRILLING,
        _inside(Stage.DRILLED, ObjectKind.DRILL),
        Step.DRILL_REMOVED,
        "Take the drill out of the guide and record it.",
    ),
    NextStep(
        Phase.ROBOT_OFF,
        _inside(Stage.DRILLED, ObjectKind.WIRE),
        Step.WIRES_REMOVED,
        "Take the wires out of the guide and record it.",
    ),
    NextStep(Phase.ROBOT_OFF, _at(Stage.DRILLED), Step.ROBOT_REMOVED, "Take the robot off and record it."),
)
_ROBOT_FIRST: Final = (
    NextStep(
        Phase.SET_UP,
        lambda s: s.robot is RobotCondition.FAULT,
        Action.RESET,
        "The robot reports a fault: see to its cause, reset it, and take a new image before you rely on the guide.",
    ),
    *(
        NextStep(
            phase,
            _unsupervised(stage),
            None,
            "Nobody supervises the robot: see to its service, the controller's power and cable; do not drill before.",
        )
        for stage, phase in ((Stage.ALIGNED, Phase.LOCKED), (Stage.VERIFIED, Phase.DRILLING))
    ),
    NextStep(
        Phase.DRILLING,
        lambda s: s.progress.stage is Stage.VERIFIED and ObjectKind.DRILL in s.kinds_inside,
        Step.DRILLED,
        "Drill through the guide, and record the hole as drilled when the drill is out again.",
    ),
    NextStep(
        Phase.VERIFICATION,
        lambda s: s.progress.stage is Stage.VERIFIED and ObjectKind.WIRE in s.kinds_inside,
        Step.WIRES_REMOVED,
        "The wires are verified: take them out and record it, then drill through the guide.",
    ),
    NextStep(
        Phase.VERIFICATION,
        lambda s: _being_localised(s) and ObjectKind.WIRE in s.kinds_inside,
        None,
        "The newest image is being localised: wait, then verify the wires with it; or take one more.",
    ),
    NextStep(
        Phase.VERIFICATION,
        lambda s: s.progress.stage is Stage.ALIGNED and ObjectKind.WIRE in s.kinds_inside and s.progress.seen,
        Action.VERIFY,
        "Verify the wires with the newest image; another one from the side shows more. Or take the wires out.",
    ),
    NextStep(
        Phase.WIRES,
        lambda s: s.progress.stage is Stage.ALIGNED and ObjectKind.WIRE in s.kinds_inside,
        Action.TAKE_IMAGE,
        "Take an image with the wires in place, then verify; or take the wires out.",
    ),
    *(
        NextStep(phase, _inside(stage, kind), step, _OUT.format(held=kind.capitalize()))
        for stage, phase in _PHASE_AT_REST.items()
        for step, kind in REMOVING_STEPS.items()
        if (stage, kind) not in _HELD_ON_PURPOSE
    ),
    NextStep(
        Phase.SET_UP,
        _robot(*_SILENT),
        None,
        "The robot does not report its state: see that its service runs and that the link to it is up.",
    ),
    NextStep(Phase.SET_UP, _robot(RobotCondition.DISCONNECTED), None, "Check the controller's power and cable."),
    NextStep(
        Phase.SET_UP,
        _robot(RobotCondition.BUTTON_PRESSED),
        None,
        "Release the stop button on the controller once its cause is known, then acknowledge the stop.",
    ),
    NextStep(
        Phase.SET_UP,
        _robot(RobotCondition.STOPPED),
        Action.ACKNOWLEDGE_STOP,
        "A stop is in force: look why, then acknowledge it.",
    ),
    NextStep(
        Phase.SET_UP,
        _robot(RobotCondition.UNREFERENCED),
        Action.REFERENCE,
        "Reference the robot, with the guide off the bone.",
    ),
    NextStep(
        Phase.MOTION,
        _robot(RobotCondition.UNDER_WAY),
        Action.STOP,
        "The robot moves, and no request of this case is under way: wait until it is locked, or stop it.",
    ),
)
_TO_THE_MOTION: Final = (
    NextStep(
        Phase.PLAN,
        lambda s: _close_to_motion(s) and not s.hexapod_agrees,
        Action.CHANGE_SETUP,
        "The case has hexapod '{hexapod}' ({case_hexapod}), the robot was started with another ({robot_hexapod}): give "
        "both the same file.",
    ),
    NextStep(Phase.MOTION, _plan(PlanStanding.APPROVED), Action.START_MOTION, "Start the motion."),
    NextStep(
        Phase.APPROVAL,
        _plan(PlanStanding.MADE),
        Action.APPROVE_PLAN,
        "A surgeon checks the plan and approves it.",
    ),
    NextStep(
        Phase.LOCALISATION,
        lambda s: s.progress.stage is Stage.POSITIONING and s.basis is Basis.ACCEPTED and not s.side_agrees,
        Action.CHANGE_SETUP,
        "The newest image's header states the {image_side} side, the case the {side} side: correct the case, or the "
        "patient's data at the C-arm, and take one more image.",
    ),
    NextStep(
        Phase.PLAN,
        _basis(Basis.ACCEPTED),
        Action.REQUEST_PLAN,
        "Request a plan from the newest localisation.",
    ),
    NextStep(
        Phase.MOUNTING,
        lambda s: s.progress.stage is Stage.POSITIONING and not s.guide_seen,
        Action.TAKE_IMAGE,
        "The newest image shows no guide: mount the robot 40 to 80 mm proximal of the nail's holes, bring the guide "
        "into the image, and take one more.",
    ),
    NextStep(
        Phase.ALIGNMENT,
        _basis(Basis.SEVERAL),
        Action.TAKE_IMAGE,
        "The newest image was rejected ({reasons}): do what its reasons say and take one more, or plan from several.",
    ),
    NextStep(
        Phase.ALIGNMENT,
        _basis(Basis.REJECTED),
        Action.TAKE_IMAGE,
        "The newest image was rejected ({reasons}): do what its reasons say and take one more.",
    ),
    NextStep(
        Phase.LOCALISATION,
        lambda s: s.progress.stage is Stage.POSITIONING and s.progress.seen,
        None,
        "Wait for the localisation of the newest image, or take one more.",
    ),
    NextStep(
        Phase.ALIGNMENT,
        _at(Stage.POSITIONING),
        Action.TAKE_IMAGE,
        "Take one image with ring, guide and both nail holes in view.",
    ),
    NextStep(
        Phase.VERIFICATION,
        _being_localised,
        None,
        "The newest image is being localised: wait, then verify the guide with it; or take one more.",
    ),
    NextStep(
        Phase.VERIFICATION,
        lambda s: s.progress.stage is Stage.ALIGNED and s.progress.seen,
        Action.VERIFY,
        "Verify the guide with the newest image, or insert wires and verify them.",
    ),
    NextStep(
        Phase.LOCKED,
        _at(Stage.ALIGNED),
        Action.TAKE_IMAGE,
        "The robot is locked: take an image of the guide, with wires in it or without, and verify.",
    ),
    NextStep(
        Phase.DRILLING,
        lambda s: s.some_drilled,
        Step.DRILLED,
        "Drill what is left through the guide ({verified_holes}), or plan the move to the next hole.",
    ),
    NextStep(Phase.DRILLING, lambda _: True, Step.DRILLED, "Drill through the guide: {verified_holes}."),
)
NEXT: Final = (*_WHILE_MOVING, *_AFTER_DRILLING, *_ROBOT_FIRST, *_TO_THE_MOTION)


def next_step(situation: Situation) -> NextStep:
    """The first row that fits."""
    return next(row for row in NEXT if row.fits(situation))


def next_sentence(situation: Situation) -> str:
    """What to do next, for people."""
    return situation.observed.fill(next_step(situation).sentence)
