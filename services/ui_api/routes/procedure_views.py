"""What clients get of the procedure: where a case stands, what may be done, by whom, and why not."""

from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from services.ui_api.core.case import Case, StepEntry
from services.ui_api.core.event_data import Step
from services.ui_api.core.next_step import next_sentence, next_step, phase_line
from services.ui_api.core.procedure_conditions import Judge
from services.ui_api.core.procedure_table import (
    ROBOT_ACTIONS,
    Action,
    Decision,
    Verdict,
    allowed_actions,
    decide,
    decide_step,
    steps_in_order,
    who_may,
)
from services.ui_api.core.roles import Role
from services.ui_api.core.situation import Situation
from services.ui_api.routes.base_view import View


class InsideView(View):
    """Something in a hole of the guide or the bone."""

    kind: Literal["wire", "drill", "screw"]
    hole_id: str


class StepView(View):
    """A step that was recorded and not withdrawn."""

    number: int
    step: str
    hole_ids: list[str] = Field(description="Empty: it concerned all holes.")
    out_of_order: bool
    why: str

    @staticmethod
    def of(entry: StepEntry) -> "StepView":
        """From the case's value."""
        recorded = entry.recorded
        return StepView(
            number=entry.number,
            step=recorded.step,
            hole_ids=list(recorded.hole_ids),
            out_of_order=recorded.out_of_order,
            why=recorded.why,
        )


class ActionView(View):
    """An action or a step: who may take it, whether it may be taken now, and if not, why and what to do."""

    name: str
    verdict: Literal["allowed", "with_reason", "refused"] = Field(
        description="`with_reason`: a step out of order, that can be recorded with `why`."
    )
    roles: list[str] = Field(description="Who may.")
    code: str = Field(description="The code that a request would be refused with; empty when it is allowed.")
    reason: str
    remedy: str
    refused_by: Literal["gateway", "robot"] | None = Field(
        description="What the robot refuses is sent to it all the same, and its operation fails."
    )

    @staticmethod
    def of(name: str, who: Iterable[Role], decision: Decision) -> "ActionView":
        """From the table's decision."""
        allowed = decision.verdict is Verdict.ALLOWED
        by: Literal["gateway", "robot"] = "robot" if decision.judge is Judge.ROBOT else "gateway"
        return ActionView(
            name=name,
            verdict=decision.verdict.value,
            roles=[str(role) for role in who],
            code=decision.code,
            reason=decision.reason,
            remedy=decision.remedy,
            refused_by=None if allowed else by,
        )


class PhaseView(View):
    """A phase on the line of the procedure."""

    name: str
    status: Literal["done", "now", "to_come"]


class ProcedureView(View):
    """How far the case is, and what may come next."""

    stage: str
    aim: str
    phase: str = Field(description="Where the case is in the protocol, from `set_up` to `closed`.")
    line: list[PhaseView] = Field(
        description="The phases in order, with a detour only while it lasts; what is done may have to be done again."
    )
    wired_hole_ids: list[str]
    inside: list[InsideView] = Field(description="What is in the guide or the bone: until it is out, nothing moves.")
    drilled_hole_ids: list[str]
    allowed_actions: list[str]
    allowed_steps: list[str] = Field(description="Steps that are in order now; others need `why`.")
    actions: list[ActionView] = Field(description="Every action, with who may, and why not where it is refused.")
    steps: list[ActionView] = Field(description="The same for every step that can be recorded.")
    next: str = Field(description="What to do next, in one sentence.")
    next_action: str | None = Field(description="The action or step that `next` asks for; null where it is to wait.")

    @staticmethod
    def of(case: Case, situation: Situation) -> "ProcedureView":
        """From the case and its situation."""
        progress, following = case.progress, next_step(situation)
        return ProcedureView(
            stage=progress.stage,
            aim=progress.aim,
            phase=following.phase,
            line=[PhaseView(name=name, status=status.value) for name, status in phase_line(following.phase)],
            wired_hole_ids=sorted(progress.wired_hole_ids),
            inside=[InsideView(kind=x.kind.value, hole_id=x.hole_id) for x in sorted(progress.inside)],
            drilled_hole_ids=sorted(case.drilled_hole_ids),
            allowed_actions=list(allowed_actions(situation)),
            allowed_steps=list(steps_in_order(situation)),
            actions=_action_views(Action, situation),
            steps=[ActionView.of(step, who_may(Action.RECORD_STEP), decide_step(situation, step)) for step in Step],
            next=next_sentence(situation),
            next_action=following.does,
        )


def robot_action_views(situation: Situation) -> list[ActionView]:
    """The actions that need no case."""
    return _action_views(ROBOT_ACTIONS, situation)


def _action_views(actions: Iterable[Action], situation: Situation) -> list[ActionView]:
    return [ActionView.of(action, who_may(action), decide(situation, action)) for action in actions]
