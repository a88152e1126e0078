"""How routes reach the gateway: one object, put on the application when it is made."""

from typing import Annotated

from fastapi import Depends, Request

from services.ui_api.routes.idempotency import Idempotency
from services.ui_api.routes.kept_views import KeptViews
from services.ui_api.service import Gateway


def gateway_of(request: Request) -> Gateway:
    """For what is read again and again: the framework takes longer over a dependency than over such an answer."""
    gateway: Gateway = request.app.state.gateway
    return gateway


def kept_views_of(request: Request) -> KeptViews:
    """Likewise."""
    kept: KeptViews = request.app.state.kept_views
    return kept


async def _gateway(request: Request) -> Gateway:
    return gateway_of(request)


async def _idempotency(request: Request) -> Idempotency:
    idempotency: Idempotency = request.app.state.idempotency
    return idempotency


async def _kept_views(request: Request) -> KeptViews:
    return kept_views_of(request)


# All are coroutines on purpose: plain functions would wait for a thread of the pool, and stop must wait for nothing.
TheGateway = Annotated[Gateway, Depends(_gateway)]
TheIdempotency = Annotated[Idempotency, Depends(_idempotency)]
TheKeptViews = Annotated[KeptViews, Depends(_kept_views)]
