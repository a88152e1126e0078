"""Routers of the API's resources and pages: where their routes lie, and what all of them have in common.

Their routes are made whole, with their whole path: an application takes them as they are (`route_index`).
"""

from typing import Any, Final

from fastapi import APIRouter
from fastapi.routing import APIRoute

from services.ui_api.routes.guards import GuardedRoute
from services.ui_api.routes.problems import PROBLEM_JSON

PREFIX: Final = "/api/v1"
PROBLEM_REFERENCE: Final = {"$ref": "#/components/schemas/Problem"}
_PROBLEMS: Final[dict[int | str, dict[str, Any]]] = {
    "default": {"description": "A problem.", "content": {PROBLEM_JSON: {"schema": PROBLEM_REFERENCE}}}
}


def resource_router(path: str = "", *, tag: str) -> APIRouter:
    """Of a resource of the API, under its prefix."""
    return plain_router(PREFIX + path, tag=tag)


def plain_router(path: str = "", *, tag: str) -> APIRouter:
    """Of what the API document has outside the prefix."""
    return APIRouter(
        prefix=path,
        tags=[tag],
        route_class=GuardedRoute,
        responses=_PROBLEMS,
        generate_unique_id_function=_name_of,
    )


def page_router(path: str = "") -> APIRouter:
    """Of pages for people, which the API document does not have."""
    return APIRouter(prefix=path, route_class=GuardedRoute, include_in_schema=False)


def _name_of(route: APIRoute) -> str:
    """One name in code, document and client."""
    return route.name
