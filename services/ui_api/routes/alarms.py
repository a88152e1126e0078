"""`/alarms`: what is to be responded to now, by priority (`core.alarms`)."""

import asyncio

from services.ui_api.core.alarms import Alarm, AlarmSituation, Priority, active_alarms
from services.ui_api.core.roles import Action
from services.ui_api.handlers.readiness import PROBE_WITHIN_S
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import View
from services.ui_api.service import Gateway

router = resource_router("/alarms", tag="health")


class AlarmView(View):
    """One alarm: how urgent it is, what holds, what was measured, and what to do."""

    code: str
    priority: Priority
    means: str
    measured: str
    remedy: str


class AlarmsView(View):
    """All alarms, the most urgent first; none is the normal state."""

    highest: Priority | None
    items: list[AlarmView]


@router.get("", openapi_extra=needs(Action.READ))
async def read_alarms(gateway: TheGateway) -> AlarmsView:
    """Alarm conditions that hold now, by priority after IEC 60601-1-8, with what to do."""
    probe = gateway.readiness.probe()
    await asyncio.wait([asyncio.wrap_future(probe)], timeout=PROBE_WITHIN_S)
    lacks = {check.name: check.measured for check in gateway.readiness.checks(probe) if not check.ok}
    alarms = [_view(alarm) for alarm in active_alarms(_situation(gateway, lacks))]
    return AlarmsView(highest=alarms[0].priority if alarms else None, items=alarms)


def _situation(gateway: Gateway, lacks: dict[str, str]) -> AlarmSituation:
    case, robot = gateway.record.ledger.open_case(), gateway.procedure.robot_situation()
    return AlarmSituation(
        robot=robot.robot,
        pending=robot.pending,
        case_is_open=case is not None,
        something_inside=bool(gateway.record.ledger.inside()),
        side_agrees=case is None or case.side_of_images in (None, case.setup.side),
        lacks=lacks,
    )


def _view(alarm: Alarm) -> AlarmView:
    row = alarm.condition
    return AlarmView(code=row.code, priority=row.priority, means=row.means, measured=alarm.measured, remedy=row.remedy)
