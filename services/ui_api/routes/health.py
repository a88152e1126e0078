"""`/healthz`, `/readyz` and `/metrics`, outside the prefix."""

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.metrics import Metrics
from services.ui_api.routes.problems import problem, problem_response
from services.ui_api.routes.views import View
from services.ui_api.service import Gateway
from shared.runtime.lifecycle import software_version

router = APIRouter(tags=["health"])
_OK = "ok"


class HealthView(View):
    """The process runs."""

    status: str
    version: str


class ReadyView(View):
    """Everything that a procedure needs is there."""

    status: str
    checks: dict[str, str]


@router.get("/healthz")
async def healthz() -> HealthView:
    """Whether the process runs."""
    return HealthView(status=_OK, version=software_version())


@router.get("/readyz", response_model=ReadyView)
def readyz(request: Request, gateway: TheGateway) -> Response:
    """Whether bus, services and database are there; 503 with what is missing."""
    checks = _checks(gateway)
    failed = {name: state for name, state in checks.items() if state != _OK}
    if not failed:
        return Response(ReadyView(status=_OK, checks=checks).model_dump_json(), media_type="application/json")
    detail = "; ".join(f"{name}: {state}" for name, state in failed.items())
    document = problem(503, "not_ready", detail, request.url.path)
    return problem_response(document.model_copy(update={"checks": checks}))


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(request: Request, gateway: TheGateway) -> Response:
    """Figures for Prometheus."""
    measured: Metrics = request.app.state.metrics
    measured.observe(gateway)
    return Response(generate_latest(measured.registry), media_type=CONTENT_TYPE_LATEST)


def _checks(gateway: Gateway) -> dict[str, str]:
    checks = {"bus": _OK if gateway.link_up() else "no router is connected"}
    for service, alive in gateway.inbox.presence.alive.items():
        checks[service] = _OK if alive else "the service is not on the bus"
    checks["database"] = _database(gateway)
    return checks


def _database(gateway: Gateway) -> str:
    try:
        return _OK if gateway.record.is_readable() else "it answers, but not what it should"
    except Exception as error:  # noqa: BLE001 - whatever a database driver raises is the finding
        return f"{type(error).__name__}: {error}"
