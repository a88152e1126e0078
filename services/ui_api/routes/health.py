"""`/healthz`, `/readyz` and `/metrics`, outside the prefix."""

import asyncio
from collections.abc import Mapping
from typing import Any, Final

from fastapi import Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from services.ui_api.core.roles import Action
from services.ui_api.handlers.readiness import PROBE_WITHIN_S, Check
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.metrics import Metrics
from services.ui_api.routes.problems import PROBLEM_JSON, problem, problem_response
from services.ui_api.routes.routers import plain_router
from services.ui_api.routes.views import View
from shared.runtime.lifecycle import software_version

router = plain_router(tag="health")
_OK = "ok"

_NOT_READY: Final[Mapping[str, Any]] = {
    "description": "Something is not as it should be; `checks` has all parts.",
    "content": {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


class HealthView(View):
    """The process runs."""

    status: str
    version: str


class CheckView(View):
    """One part that a procedure needs: what was measured, and what to do when it is not as it should be."""

    name: str
    ok: bool
    code: str
    measured: str
    remedy: str


class ReadyView(View):
    """Everything that a procedure needs is there."""

    status: str
    checks: list[CheckView]


@router.get("/healthz", openapi_extra=needs(Action.SEE_HEALTH))
async def read_health() -> HealthView:
    """Whether the process runs."""
    return HealthView(status=_OK, version=software_version())


@router.get(
    "/readyz",
    response_model=ReadyView,
    responses={503: dict(_NOT_READY)},
    openapi_extra=needs(Action.SEE_HEALTH),
)
async def read_readiness(request: Request, gateway: TheGateway) -> Response:
    """Whether bus, services, robot, database and disk do what they are there for; 503 with what does not."""
    probe = gateway.readiness.probe()
    await asyncio.wait([asyncio.wrap_future(probe)], timeout=PROBE_WITHIN_S)
    checks = [_view(check) for check in gateway.readiness.checks(probe)]
    failed = [check for check in checks if not check.ok]
    if not failed:
        return Response(ReadyView(status=_OK, checks=checks).model_dump_json(), media_type="application/json")
    detail = "; ".join(f"{check.name}: {check.measured}" for check in failed)
    document = problem(503, "not_ready", detail, request.url.path)
    return problem_response(document.model_copy(update={"checks": [check.model_dump() for check in checks]}))


def _view(check: Check) -> CheckView:
    return CheckView(name=check.name, ok=check.ok, code=check.code, measured=check.measured, remedy=check.remedy)


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}}}},
    openapi_extra=needs(Action.SEE_METRICS),
)
def read_metrics(request: Request, gateway: TheGateway) -> Response:
    """Figures for Prometheus."""
    measured: Metrics = request.app.state.metrics
    measured.observe(gateway)
    return Response(generate_latest(measured.registry), media_type=CONTENT_TYPE_LATEST)
