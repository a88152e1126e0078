"""What clients get: plans, approvals and the robot."""

from pydantic import Field

from services.ui_api.core.case import PlanEntry
from services.ui_api.routes.procedure_views import ActionView
from services.ui_api.routes.views import View
from shared.messages.base import Sha256, UnixNanoseconds
from shared.messages.registration import Plan
from shared.messages.robot import RobotState


class ApprovalView(View):
    """A surgeon's consent."""

    plan: int
    plan_sha256: Sha256
    approved_by: str
    approved_at_ns: UnixNanoseconds
    authenticated_by: str | None = Field(
        description="How the surgeon showed who he is: `password`, or `simulation_token`; null in old records."
    )


class PlanView(View):
    """A plan, ready for approval; `sha256` is also its ETag."""

    number: int
    sha256: Sha256
    localisation: int
    made_at_ns: UnixNanoseconds
    approval: ApprovalView | None
    validity: str = Field(description="`current`, or `stale` when it moves nothing any more.")
    stale_because: str | None
    plan: Plan

    @staticmethod
    def of(entry: PlanEntry, plan: Plan, stale_because: str | None) -> "PlanView":
        """From the ledger's value and the plan's document."""
        made, approval = entry.made, entry.approval
        return PlanView(
            number=made.number,
            sha256=made.plan_sha256,
            localisation=made.localisation,
            made_at_ns=entry.made_at_ns,
            approval=None
            if approval is None
            else ApprovalView(
                plan=made.number,
                plan_sha256=approval.plan_sha256,
                approved_by=approval.approved_by,
                approved_at_ns=approval.approved_at_ns,
                authenticated_by=approval.authenticated_by,
            ),
            validity="current" if stale_because is None else "stale",
            stale_because=stale_because,
            plan=plan,
        )


class RobotView(View):
    """The robot as last seen, with its age."""

    state: RobotState | None
    age_s: float | None
    validity: str = Field(description="`current`, `stale`, or `absent` when it was never seen.")
    service_alive: bool
    simulated: bool | None = Field(description="Read from the controller's `*IDN?`; null when it has not said.")
    image_source: str = Field(description="Manufacturer and model in the newest image.")
    image_source_simulated: bool | None
    actions: list[ActionView] = Field(description="What may be done with it now, by whom, and why not.")


class StopView(View):
    """A confirmed stop: written, and the controller shows standstill with brakes on. Anything else is a 504."""

    confirmed: bool
    state: str | None
    detail: str
    recorded: bool


def says_simulated(identity: str) -> bool | None:
    """Whether a device says of itself that it is simulated; None when it has said nothing."""
    if not identity:
        return None
    return any(word in identity.lower() for word in ("simulat", "virtual"))
