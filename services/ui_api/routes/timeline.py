"""`/cases/{id}/timeline`: what happened in a case, for people: when, who, what, and where to look at it."""

from datetime import UTC, datetime
from functools import singledispatch

from pydantic import Field

from services.ui_api.core import computation_event_data, event_data, robot_event_data
from services.ui_api.core.events import Event, EventData
from services.ui_api.core.roles import Action
from services.ui_api.record.record import PAGE
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.pages import Cursor, Limit, Page, cursor_after, position_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import View
from shared.messages.base import UnixNanoseconds

router = resource_router("/cases/{case_id}/timeline", tag="cases")


class TimelineEntry(View):
    """One thing that happened."""

    sequence: int = Field(description="Number of its event in the log.")
    at: datetime
    at_ns: UnixNanoseconds
    who: str
    kind: str
    what: str = Field(description="One sentence.")
    why: str
    href: str | None = Field(description="What it made, or what it is about.")
    picture: str | None = Field(description="The picture that shows it.")


@router.get("", openapi_extra=needs(Action.READ))
def read_timeline(case_id: str, gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[TimelineEntry]:
    """What happened, the oldest first; frames of running fluoroscopy and what only machines need are left out."""
    gateway.cases.case(case_id)
    place, found = position_of(cursor), list[TimelineEntry]()
    while len(found) <= limit:
        events = gateway.record.events_after(place, case_id)
        found += [entry for event in events if (entry := _entry(case_id, event)) is not None]
        if len(events) < PAGE:
            break
        place = events[-1].sequence
    items = found[:limit]
    return Page(items=items, next_cursor=cursor_after(items[-1].sequence) if len(found) > limit else None)


def _entry(case_id: str, event: Event) -> TimelineEntry | None:
    what = _what(event.data)
    if what is None:
        return None
    return TimelineEntry(
        sequence=event.sequence,
        at=datetime.fromtimestamp(event.at_ns / 1e9, UTC),
        at_ns=event.at_ns,
        who=event.who,
        kind=event.kind,
        what=what,
        why=event.why,
        href=_href(event.data, f"/api/v1/cases/{case_id}"),
        picture=_picture(event.data),
    )


@singledispatch
def _what(data: EventData) -> str | None:  # noqa: ARG001 - the signature all kinds share
    """The sentence of an event; None when people need not see it."""
    return None


@_what.register
def _(data: event_data.CaseOpened) -> str:
    setup = data.setup
    return f"Case opened: {setup.side} {setup.bone}, nail {setup.nail.name}, mounted on {setup.mount}."


@_what.register
def _(data: event_data.SetupChanged) -> str:
    return f"Set-up changed to revision {data.revision}; what was measured before is stale."


@_what.register
def _(data: event_data.ImageReceived) -> str | None:
    return None if data.in_run else f"Image {data.image_sha256[:12]} received."


@_what.register
def _(data: event_data.ImageSkipped) -> str | None:
    return None if data.code == "superseded" else f"Image {data.image_sha256[:12]}: no {data.step}. {data.message}"


@_what.register
def _(data: event_data.LocalisationReceived) -> str:
    why = f" ({', '.join(data.reason_codes)})" if data.reason_codes else ""
    return f"Localisation {data.number} {data.verdict}{why}."


@_what.register
def _(data: event_data.PlanMade) -> str:
    return f"Plan {data.number} made from localisation {data.localisation}, for {', '.join(data.hole_ids)}."


@_what.register
def _(data: event_data.PlanRefused) -> str:
    return f"No plan from localisation {data.localisation}: {data.message}"


@_what.register
def _(data: event_data.PlanApproved) -> str:
    return f"Plan {data.number} approved by {data.approved_by}."


@_what.register
def _(data: event_data.ApprovalWithdrawn) -> str:
    return f"The approval of plan {data.number} was withdrawn."


@_what.register
def _(data: robot_event_data.OperationRequested) -> str:
    plan = "" if data.plan_number is None else f" to the target of plan {data.plan_number}"
    return f"Robot asked to {data.verb.replace('_', ' ')}{plan}."


@_what.register
def _(data: robot_event_data.OperationEnded) -> str:
    return f"Robot's command {data.status}{': ' + data.message if data.message else '.'}"


@_what.register
def _(data: computation_event_data.ComputationRequested) -> str:
    return f"Begun without waiting for it: {data.says}."


@_what.register
def _(data: computation_event_data.ComputationEnded) -> str:
    return f"What was computed has {data.status}{': ' + data.message if data.message else '.'}"


@_what.register
def _(data: robot_event_data.StopRequested) -> str:
    return f"Stop, {'confirmed' if data.confirmed else 'not confirmed'}: {data.message}"


@_what.register
def _(data: event_data.VerificationMade) -> str:
    why = f" ({', '.join(data.reason_codes)})" if data.reason_codes else ""
    return f"Verification {data.number} {data.verdict}{why}."


@_what.register
def _(data: event_data.VerificationRefused) -> str:
    return f"No verification: {data.message}"


@_what.register
def _(data: event_data.QaReported) -> str:
    return f"Quality report {data.number} {data.verdict}."


@_what.register
def _(data: event_data.StepRecorded) -> str:
    holes = f" ({', '.join(data.hole_ids)})" if data.hole_ids else ""
    order = ", out of order" if data.out_of_order else ""
    return f"Step recorded: {data.step.replace('_', ' ')}{holes}{order}."


@_what.register
def _(data: event_data.StepWithdrawn) -> str:
    return f"Step {data.number} ({data.step.replace('_', ' ')}) taken back: it was not done."


def _href(data: EventData, case: str) -> str | None:
    match data:
        case event_data.ImageReceived() | event_data.ImageSkipped():
            return f"/api/v1/images/{data.image_sha256}"
        case event_data.LocalisationReceived():
            return f"{case}/localisations/{data.number}"
        case event_data.PlanMade() | event_data.PlanApproved() | event_data.ApprovalWithdrawn():
            return f"{case}/plans/{data.number}"
        case robot_event_data.OperationRequested() | robot_event_data.OperationEnded():
            return f"/api/v1/operations/{data.operation_id}"
        case computation_event_data.ComputationRequested() | computation_event_data.ComputationEnded():
            return f"/api/v1/operations/{data.operation_id}"
        case event_data.VerificationMade():
            return f"{case}/verifications/{data.number}"
        case event_data.QaReported():
            return f"{case}/qa-reports/{data.number}"
        case _:
            return case


def _picture(data: EventData) -> str | None:
    match data:
        case event_data.ImageReceived():
            return f"/api/v1/images/{data.image_sha256}.png"
        case event_data.LocalisationReceived() if data.overlay_sha256 is not None:
            return f"/api/v1/images/{data.image_sha256}.png?view=overlay"
        case event_data.VerificationMade():
            return f"/api/v1/images/{data.images[0]}.png"
        case _:
            return None
