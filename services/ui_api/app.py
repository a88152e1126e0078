"""The FastAPI application: all routes over one gateway."""

from collections.abc import Sequence
from functools import cache

from fastapi import FastAPI

from services.ui_api.api_document.document import whole_document
from services.ui_api.api_document.page import POLICY, page_of
from services.ui_api.handlers.acting import Acting
from services.ui_api.routes import (
    alarms,
    api_page,
    cases,
    computations,
    console,
    diagnosis,
    events,
    health,
    images,
    live,
    localisations,
    motions,
    operations,
    parts,
    passkeys,
    plans,
    qa_reports,
    robot,
    sessions,
    setup,
    timeline,
    users,
    verifications,
    virtual_room,
)
from services.ui_api.routes.acting_first import ActingFirst
from services.ui_api.routes.body_limit import BodyLimitMiddleware
from services.ui_api.routes.console_files import console_files
from services.ui_api.routes.idempotency import Idempotency
from services.ui_api.routes.kept_views import KeptViews
from services.ui_api.routes.metrics import MeasuringMiddleware, Metrics
from services.ui_api.routes.problems import add_problem_handlers
from services.ui_api.routes.request_gate import RequestGate
from services.ui_api.routes.request_trace import RequestTrace
from services.ui_api.routes.route_index import RouteIndex
from services.ui_api.routes.routers import PREFIX as PREFIX
from services.ui_api.routes.streams import Streams
from services.ui_api.routes.virtual_room import VirtualRoom
from services.ui_api.service import Gateway
from shared.runtime.lifecycle import software_version

TITLE = "distalock gateway"


def make_app(
    gateway: Gateway,
    allowed_hosts: Sequence[str] = (),
    cors_origins: Sequence[str] = (),
    virtual_room_url: str | None = None,
) -> FastAPI:
    """The application on an open gateway; the caller closes the gateway after the server has ended.

    Parameters
    ----------
    allowed_hosts
        Names under which this machine may be called, besides addresses and `localhost`.
    cors_origins
        Other origins whose pages may call this machine.
    virtual_room_url
        Control API of the virtual operating room; None where there is none.
    """
    app = routed_app(gateway.acting)
    app.add_middleware(RequestGate, allowed_hosts=allowed_hosts, cors_origins=cors_origins)
    app.add_middleware(RequestTrace)
    app.state.gateway = gateway
    app.state.console = console_files()
    app.state.virtual_room = None if virtual_room_url is None else VirtualRoom(virtual_room_url)
    app.state.idempotency = Idempotency(gateway.record)
    app.state.kept_views = KeptViews()
    app.state.streams = Streams(gateway)
    gateway.record.listen(app.state.metrics.note_events)
    gateway.record.on_write = app.state.metrics.write_seconds.observe
    return app


def routed_app(acting: Acting | None = None) -> FastAPI:
    """The application without a gateway behind it: enough to write the OpenAPI file."""
    app = FastAPI(
        title=TITLE,
        version=software_version(),
        docs_url=None,  # its page would load scripts from a CDN
        redoc_url=None,
        # Traces and figures are the gateway's own (`request_trace`, `metrics`); no variable may have others sent out.
        telemetry={"tracing": False, "metrics": False, "logs": False},
    )
    app.state.metrics = Metrics()
    app.add_middleware(ActingFirst, acting=acting or Acting())
    app.add_middleware(BodyLimitMiddleware)
    app.add_middleware(MeasuringMiddleware, metrics=app.state.metrics)
    for resource in (
        cases,
        timeline,
        images,
        localisations,
        plans,
        motions,
        operations,
        verifications,
        qa_reports,
        computations,
        robot,
        alarms,
        events,
        live,
        parts,
        sessions,
        passkeys,
        users,
        setup,
        health,
        diagnosis,
        api_page,
        console,
        virtual_room,
    ):
        app.router.routes.extend(resource.router.routes)
    app.state.routes = app.router.middleware_stack = RouteIndex(app.router.app, app.routes)
    add_problem_handlers(app)
    app.state.api_page = cache(lambda: (page_of(openapi_document(app)), POLICY))
    app.openapi = lambda: openapi_document(app)  # type: ignore[method-assign]  # FastAPI's own way to extend it
    return app


def openapi_document(app: FastAPI) -> dict[str, object]:
    """The OpenAPI document, written once."""
    if app.openapi_schema is None:
        app.openapi_schema = whole_document(app.title, app.routes)
    return app.openapi_schema
