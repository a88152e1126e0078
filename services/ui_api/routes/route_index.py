"""Finds the route of a request by the shape of its path, without asking all of them one after another.

The framework asks some eighty routes in turn, each of them more than once where routers include one another: that took
longer than all of the rest of a state read. Here it asks those alone that have as many segments as the path, and the
same resource. What is not found here goes the framework's own way, which knows what to answer.
"""

from collections.abc import Iterable, Sequence
from typing import Final

from fastapi.routing import APIRoute
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Receive, Scope, Send

# Of "/api/v1/RESOURCE/...", cut at its slashes.
_RESOURCE_AT: Final = 3
_Shape = tuple[int, str]


class RouteIndex:
    """Middleware between the application and its router.

    Parameters
    ----------
    routes
        Those of the router, in its order: the first that fits is taken.
    """

    def __init__(self, app: ASGIApp, routes: Sequence[BaseRoute]) -> None:
        self._app, self._routes = app, [route for route in routes if isinstance(route, APIRoute)]
        self._of_shape: dict[_Shape, list[APIRoute]] = {}
        for route in _with_a_shape(self._routes):
            self._of_shape.setdefault(_shape(route.path), []).append(route)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request to its route, or to the router."""
        if scope["type"] == "http":
            for route in self._of_shape.get(_shape(scope["path"]), ()):
                match, found = route.matches(scope)
                if match is Match.FULL:
                    scope.update(found)
                    await route.handle(scope, receive, send)
                    return
        await self._app(scope, receive, send)

    def methods_of(self, path: str) -> tuple[str, ...]:
        """Methods of a path, sorted; empty when there is no such path. The framework names those of one route alone."""
        found = {name for route in self._routes if route.path_regex.match(path) for name in route.methods or ()}
        return tuple(sorted(found))


def _shape(path: str) -> _Shape:
    segments = path.split("/")
    return len(segments), segments[_RESOURCE_AT] if len(segments) > _RESOURCE_AT else segments[-1]


def _with_a_shape(routes: Iterable[APIRoute]) -> Iterable[APIRoute]:
    """Up to the first route that fits paths of several shapes: those behind it must not go before it."""
    for route in routes:
        name = _shape(route.path)[1]
        if ":path}" in route.path or "{" in name:
            return
        yield route
