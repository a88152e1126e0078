"""`docs/procedure.md`: the whole procedure as a diagram and as tables, from the tables that the gateway decides by."""

from collections.abc import Iterator
from typing import Final

from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import INSERTING_STEPS, REMOVING_STEPS, inside_after
from services.ui_api.core.next_step import NEXT, Phase, next_step
from services.ui_api.core.procedure import Aim, Progress, Stage, Trigger
from services.ui_api.core.procedure_conditions import Judge
from services.ui_api.core.procedure_table import STEPS_IN_ORDER, TABLE, Action, who_may
from services.ui_api.core.situation import Basis, Pending, PlanStanding, RobotCondition, Situation

_HEAD: Final = """# The procedure as the gateway leads it

Research software, not a medical device. The protocol for people is in [protocol.md](protocol.md). This page is printed
by `make generated` from the tables by which the gateway decides (`procedure.py`, `procedure_table.py`,
`procedure_conditions.py` and `next_step.py` in `services/ui_api/core`): `procedure` in every case, and the refusal of
every request, come from them.

## Phases

A phase is what is to be done next. Arrows are what comes of doing it, with a robot that is ready, and the setbacks. A
new image begins again at `localisation` wherever a plan waits, and every phase can be repeated or abandoned.

"""
_BASIS: Final = {Aim.NONE: Basis.NOTHING}
_PLAN: Final = {Aim.PLANNED: PlanStanding.MADE, Aim.APPROVED: PlanStanding.APPROVED}
# What comes of what is next.
_OUTCOMES: Final[dict[Action | Step | None, tuple[Trigger, ...]]] = {
    None: (Trigger.LOCALISATION_ACCEPTED, Trigger.LOCALISATION_REJECTED),
    Action.TAKE_IMAGE: (Trigger.IMAGE_RECEIVED,),
    Action.REQUEST_PLAN: (Trigger.PLAN_MADE,),
    Action.APPROVE_PLAN: (Trigger.PLAN_APPROVED,),
    Action.START_MOTION: (Trigger.MOTION_REQUESTED, Trigger.APPROVAL_WITHDRAWN),
    Action.STOP: (Trigger.MOTION_REACHED, Trigger.MOTION_CUT_SHORT),
    Action.VERIFY: (Trigger.VERIFICATION_ACCEPTED, Trigger.VERIFICATION_REJECTED),
    Step.DRILLED: (Trigger.ALL_HOLES_DRILLED,),
    Step.ROBOT_REMOVED: (Trigger.ROBOT_REMOVED,),
    Step.FINISHED: (Trigger.FINISHED,),
}
_CHANGES_INSIDE: Final = (*INSERTING_STEPS, *REMOVING_STEPS)
_HOLE: Final = frozenset({"distal"})


def procedure_page() -> str:
    """The page."""
    return "\n".join((_HEAD + _diagram(), _next_table(), _action_table(), _condition_table(), _step_table()))


def _situation(progress: Progress) -> Situation:
    """A situation in which all else is as the progress suggests."""
    moving = progress.stage is Stage.MOVING
    return Situation(
        progress=progress,
        basis=_BASIS.get(progress.aim, Basis.ACCEPTED),
        plan=_PLAN.get(progress.aim, PlanStanding.NONE),
        pending=Pending.MOVE if moving else Pending.NOTHING,
        robot=RobotCondition.UNDER_WAY if moving else RobotCondition.READY,
        has_images=True,
        some_drilled=progress.stage in (Stage.DRILLED, Stage.ROBOT_REMOVED),
        all_screwed=bool(progress.inside) and progress.stage is Stage.ROBOT_REMOVED,
    )


def _followers(progress: Progress) -> Iterator[tuple[str, Progress]]:
    """What can come of doing what is next, or of wires in the locked guide, and its name."""
    following = next_step(_situation(progress))
    for trigger in () if progress.closed else _OUTCOMES.get(following.does, ()):
        yield trigger, progress.after(trigger)
    steps = [following.does] if following.does in _CHANGES_INSIDE else []
    steps += [Step.WIRES_INSERTED] if following.phase is Phase.LOCKED else []
    steps += [Step.WIRES_REMOVED] if following.phase is Phase.WIRES else []
    for step in steps:
        inside = inside_after(progress.inside, Step(str(step)), _HOLE)
        yield str(step), Progress(progress.stage, progress.aim, inside, seen=False)


def _edges() -> list[tuple[Phase, Phase, str]]:
    """Every way from one phase to another, found by going through the tables."""
    found: dict[tuple[Phase, Phase, str], None] = {}
    waiting, known = [Progress()], {Progress()}
    while waiting:
        progress = waiting.pop(0)
        before = next_step(_situation(progress)).phase
        for name, after in _followers(progress):
            reached = next_step(_situation(after)).phase
            if reached is not before:
                found[before, reached, name] = None
            if after not in known:
                known.add(after)
                waiting.append(after)
    order = list(Phase)
    return sorted(found, key=lambda edge: (order.index(edge[0]), order.index(edge[1]), edge[2]))


def _diagram() -> str:
    joined: dict[tuple[Phase, Phase], list[str]] = {}
    for before, after, name in _edges():
        joined.setdefault((before, after), []).append(name)
    arrows = [f"    {before} --> {after}: {', '.join(names)}" for (before, after), names in joined.items()]
    begin = f"    [*] --> {Phase.SET_UP}\n    {Phase.SET_UP} --> {Phase.ALIGNMENT}: robot ready"
    again = f"    {Phase.LOCALISATION} --> {Phase.ALIGNMENT}: {Trigger.LOCALISATION_REJECTED}"
    mounting = f"    {Phase.LOCALISATION} --> {Phase.MOUNTING}: no guide in the image"
    back = f"    {Phase.MOUNTING} --> {Phase.LOCALISATION}: image_received"
    lines = [
        "```mermaid",
        "stateDiagram-v2",
        begin,
        *arrows,
        again,
        mounting,
        back,
        f"    {Phase.CLOSED} --> [*]",
        "```",
        "",
    ]
    return "\n".join(lines)


def _next_table() -> str:
    head = "## What is next\n\nRows are tried in order; the first that fits is `procedure.next`, with `phase` and "
    head += "`next_action`. Names in braces are put in.\n\n| phase | `next_action` | sentence |\n|---|---|---|\n"
    rows = dict.fromkeys(f"| `{r.phase}` | {f'`{r.does}`' if r.does else ''} | {r.sentence} |" for r in NEXT)
    return head + "\n".join(rows) + "\n"


def _action_table() -> str:
    head = "## Actions\n\nWhat must hold, in the order in which it is checked; the first that does not is the reason."
    head += " What the robot refuses is sent to it all the same, because its state may be newer than the one seen here."
    head += "\n\n| action | how | who may | what must hold |\n|---|---|---|---|\n"
    return head + "\n".join(_action_row(action) for action in Action) + "\n"


def _action_row(action: Action) -> str:
    row = TABLE[action]
    who = ", ".join(who_may(action))
    return f"| `{action}` | {row.request} | {who} | {'; '.join(one.needs for one in row.conditions) or 'nothing'} |"


def _condition_table() -> str:
    head = "## Why not\n\n| what must hold | code | what is observed | remedy | refused by |\n|---|---|---|---|---|\n"
    conditions = dict.fromkeys(one for row in TABLE.values() for one in row.conditions)
    rows = (
        f"| {one.needs} | `{one.code}` | {one.observed} | {one.remedy} | "
        f"{'the robot' if one.judge is Judge.ROBOT else 'the gateway'} |"
        for one in conditions
    )
    return head + "\n".join(rows) + "\n"


def _step_table() -> str:
    head = (
        "## Steps in order\n\n"
        "A step that takes something out is in order while that is inside. One that is not in order can be recorded\n"
        "with a reason (`why`), except while the robot moves and in a closed case."
    )
    rows = (
        f"| `{stage}` | {', '.join(f'`{step}`' for step in steps) or 'none'} |"
        for stage, steps in STEPS_IN_ORDER.items()
    )
    return head + "\n\n| stage | steps |\n|---|---|\n" + "\n".join(rows) + "\n"
