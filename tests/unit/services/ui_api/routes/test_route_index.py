"""Every route is found by the shape of its path, and is the one that the framework itself would have taken."""

import asyncio
import re

import pytest
from fastapi import APIRouter, Response
from fastapi.routing import APIRoute
from starlette.routing import Match
from starlette.types import Message, Receive, Scope, Send

from services.ui_api.app import routed_app
from services.ui_api.routes.route_index import RouteIndex

APP = routed_app()
ROUTES = [route for route in APP.routes if isinstance(route, APIRoute)]


def asked(method: str, path: str) -> Scope:
    return {"type": "http", "method": method, "path": path, "root_path": "", "headers": []}


def by_framework(method: str, path: str) -> APIRoute:
    return next(route for route in ROUTES if route.matches(asked(method, path))[0] is Match.FULL)


async def nothing() -> Message:
    return {"type": "http.request"}


async def unheard(_: Message) -> None: ...


class Asked(Exception):
    """The router was asked."""


async def router(_scope: Scope, _receive: Receive, _send: Send) -> None:
    raise Asked


@pytest.fixture(scope="module")
def noting() -> tuple[RouteIndex, list[APIRoute]]:
    """An index whose routes are not carried out, and those that it took."""
    taken: list[APIRoute] = []
    return RouteIndex(router, [_Noting(one, taken) for one in ROUTES]), taken


@pytest.mark.parametrize("route", ROUTES, ids=lambda route: f"{min(route.methods)} {route.path}")
def test_a_route_is_found_as_the_framework_finds_it(route: APIRoute, noting: tuple[RouteIndex, list[APIRoute]]) -> None:
    index, taken = noting
    path = re.sub(r"{[^}]*}", "x", route.path)
    for method in route.methods or ():
        taken.clear()
        try:
            asyncio.run(index(asked(method, path), nothing, unheard))
        except Asked:
            assert ":path" in route.path or "virtual-room" in route.path
        else:
            assert [taken[0].path, taken[0].methods] == [(f := by_framework(method, path)).path, f.methods]


class _Noting(APIRoute):
    """A route that is not carried out."""

    def __init__(self, route: APIRoute, taken: list[APIRoute]) -> None:
        super().__init__(route.path, route.endpoint, methods=route.methods)
        self.taken = taken

    async def handle(self, _scope: Scope, _receive: Receive, _send: Send) -> None:
        self.taken.append(self)


def test_what_fits_no_route_or_another_method_is_the_routers() -> None:
    index = RouteIndex(router, ROUTES)
    for method, path in (("GET", "/api/v1/nothing"), ("DELETE", "/api/v1/robot"), ("GET", "/api/v1/robot\n")):
        with pytest.raises(Asked):
            asyncio.run(index(asked(method, path), nothing, unheard))
    assert index.methods_of("/api/v1/cases/x") == ("GET", "PATCH")
    assert index.methods_of("/api/v1/nothing") == ()


def test_what_stands_behind_a_route_of_any_length_does_not_go_before_it() -> None:
    own = APIRouter()
    for path in ("/api/v1/{rest:path}", "/api/v1/robot"):
        own.add_api_route(path, nothing, response_class=Response)
    with pytest.raises(Asked):
        asyncio.run(RouteIndex(router, own.routes)(asked("GET", "/api/v1/robot"), nothing, unheard))
