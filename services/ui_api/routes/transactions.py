"""The transaction of a request: within it, and before anything else, access of whoever asks is checked a last time.

Comparing a password, making a hash and waiting for another service or for the record take time, in which an
administrator may have ended it. Routes with an idempotency key have this by `idempotency`, all others by `TheWrite`.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Annotated

from fastapi import Depends, Request

from services.ui_api.record.unit_of_work import UnitOfWork
from services.ui_api.service import Gateway

Write = Callable[[], AbstractContextManager[UnitOfWork]]


def require_still(request: Request) -> None:
    """Refuse whoever has lost access since his request was admitted; call it in the transaction; raises `Refused`."""
    _gateway_of(request).access.require_still(request.state.user, request.state.action)


@contextmanager
def _writing(request: Request) -> Iterator[UnitOfWork]:
    with _gateway_of(request).record.write() as unit:
        require_still(request)
        yield unit


async def _write(request: Request) -> Write:
    return partial(_writing, request)


def _gateway_of(request: Request) -> Gateway:
    gateway: Gateway = request.app.state.gateway
    return gateway


# Only for routes whose action needs a login, as `guards.TheUser`.
TheWrite = Annotated[Write, Depends(_write)]
