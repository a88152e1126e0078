"""Every route names its action, and does it for the roles of the table alone."""

import re
from pathlib import Path

import httpx
import pytest
from fastapi import APIRouter
from fastapi.routing import APIRoute, APIWebSocketRoute

from services.ui_api import app as application
from services.ui_api.core.roles import PERMISSION_OF, PERMISSIONS, Action, Role, WithoutLogin, may, permission_lines
from services.ui_api.routes import live
from services.ui_api.routes.guards import ACTION_KEY, GuardedRoute
from tests.unit.services.ui_api.people import add_account, signed_in
from tests.unit.services.ui_api.room import Room, new_key

# It streams without end, or ends the very session that the test uses.
_LEFT_OUT = {"/api/v1/events", "/api/v1/cases/{case_id}/events", "/api/v1/sessions/current"}


def _routers() -> list[APIRouter]:
    resources = [getattr(application, name) for name in vars(application)]
    return [resource.router for resource in resources if hasattr(resource, "router")]


def _routes() -> list[tuple[str, str, Action]]:
    """Method, path and action of every route."""
    return [
        (method, route.path, route.action)
        for router in _routers()
        for route in router.routes
        if isinstance(route, GuardedRoute)
        for method in sorted(route.methods or ())
    ]


def test_every_route_names_its_action() -> None:
    routes = [route for router in _routers() for route in router.routes]
    assert len(routes) > 40
    unguarded = [
        getattr(route, "path", route)
        for route in routes
        if not isinstance(route, GuardedRoute)
        and not (isinstance(route, APIWebSocketRoute) and hasattr(route.endpoint, ACTION_KEY))
    ]
    assert unguarded == []
    assert {action for _, _, action in _routes()} == set(Action)
    assert getattr(live.router.routes[0].endpoint, ACTION_KEY) is Action.READ  # type: ignore[attr-defined]


def test_a_route_without_an_action_cannot_be_made() -> None:
    router = APIRouter(route_class=GuardedRoute)
    with pytest.raises(TypeError, match=r"the route /nothing names no action"):
        router.add_api_route("/nothing", lambda: None)
    assert not issubclass(APIRoute, GuardedRoute)


def test_the_table_has_a_row_for_every_action() -> None:
    assert [one.action for one in PERMISSIONS] == list(Action)
    open_ones = {one.action for one in PERMISSIONS if one.without_login is not WithoutLogin.NOBODY}
    assert open_ones == {Action.SEE_HEALTH, Action.OPEN_CONSOLE, Action.SIGN_IN, Action.STOP, Action.SEE_METRICS}
    assert {role for role in Role if may([role], Action.APPROVE_PLAN)} == {Role.SURGEON}
    assert not may([Role.ADMINISTRATOR], Action.READ)


def test_the_page_prints_the_table() -> None:
    page = (Path(__file__).parents[5] / "docs" / "rest.md").read_text(encoding="utf-8")
    assert "\n".join(permission_lines()) in page, "run make generated"


@pytest.mark.requirement("GW-07")
@pytest.mark.parametrize("role", list(Role))
def test_a_role_does_what_the_table_says_and_nothing_else(quiet_room: Room, role: Role) -> None:
    name = f"{role}-of-the-table"
    add_account(quiet_room, name, role)
    with signed_in(quiet_room, name) as client:
        for method, path, action in _routes():
            allowed = may([role], action)
            if path in _LEFT_OUT and allowed:
                continue
            answer = client.request(method, re.sub(r"\{\w+\}", "0", path), headers={"Idempotency-Key": new_key()})
            refused = answer.status_code in (401, 403) and answer.json()["code"] == "not_permitted"
            assert refused is not allowed, f"{role} {method} {path}: {answer.status_code} {answer.text[:200]}"


@pytest.mark.requirement("GW-07")
def test_without_a_login_only_what_the_table_opens_is_done(quiet_room: Room) -> None:
    with httpx.Client(base_url=quiet_room.client.base_url, timeout=quiet_room.client.timeout) as nobody:
        for method, path, action in _routes():
            answer = nobody.request(method, re.sub(r"\{\w+\}", "0", path), content=b"{not JSON")
            refused = answer.status_code == 401 and answer.json()["code"] == "token_missing"
            assert refused is (PERMISSION_OF[action].without_login is WithoutLogin.NOBODY), f"{method} {path}"
        assert nobody.get("/openapi.json").status_code == 200
