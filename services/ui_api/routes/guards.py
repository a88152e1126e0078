"""What stands before every route: the action that it names, and whether whoever asks may do it.

A route says `openapi_extra=needs(Action.READ)`. It is refused before its body is read, and once more when the body has
come, which may take seconds, and in its transaction (`transactions`); a route that names no action cannot be made.
"""

from collections.abc import Awaitable, Callable, Coroutine
from typing import Annotated, Any, Final

from fastapi import Depends, HTTPException, Request, WebSocket
from fastapi.routing import APIRoute
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import Response

from services.ui_api.core.identity import User
from services.ui_api.core.roles import PERMISSION_OF, Action, WithoutLogin
from services.ui_api.handlers.commands import Asked
from services.ui_api.handlers.refusals import Refused
from services.ui_api.routes.access import gateway_of
from services.ui_api.routes.conditional import conditional
from services.ui_api.routes.problems import log_refusal, problem_of, sender_of
from services.ui_api.routes.request_checks import query_parameters, require_json, require_known_parameters
from services.ui_api.routes.sparse import sparse
from services.ui_api.service import Gateway

ACTION_KEY: Final = "x-distalock-action"
NEVER_LIMITED_KEY: Final = "x-distalock-never-limited"
# For a route whose requests keep the robot moving, whatever its action is.
NEVER_LIMITED: Final = {NEVER_LIMITED_KEY: True}
# Who stops is never told to wait; probes of the process cost nothing and decide whether it is restarted.
_NEVER_LIMITED: Final = frozenset({Action.STOP, Action.SEE_HEALTH})
ACCESS_COOKIE: Final = "distalock_access"
SECURITY_SCHEMES: Final = {
    "bearer": {"type": "http", "scheme": "bearer", "description": "Programs: the access token of POST /sessions."},
    "cookie": {
        "type": "apiKey",
        "in": "cookie",
        "name": ACCESS_COOKIE,
        "description": "Pages: POST /sessions sets it.",
    },
}
_LOGIN: Final[list[dict[str, list[str]]]] = [{"bearer": []}, {"cookie": []}]
_LOGIN_IS_OPTIONAL: Final[list[dict[str, list[str]]]] = [*_LOGIN, {}]
_SCHEME: Final = "bearer "
# Status code of RFC 6455, 7.4.1.
POLICY_VIOLATION: Final = 1008


def needs(action: Action) -> dict[str, Any]:
    """What a route declares: its action, and in the API document how to sign in for it."""
    is_open = PERMISSION_OF[action].without_login is not WithoutLogin.NOBODY
    never = {NEVER_LIMITED_KEY: True} if action in _NEVER_LIMITED else {}
    return {ACTION_KEY: str(action), "security": _LOGIN_IS_OPTIONAL if is_open else _LOGIN, **never}


class GuardedRoute(APIRoute):
    """A route that names its action; whoever may not do it is refused before the body is read."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The route's handler behind its guard; raises `TypeError` when the route names no action."""
        action, handler = self.action, super().get_route_handler()
        known, takes_json = query_parameters(self.dependant), self.body_field is not None
        is_limited = not (self.openapi_extra or {}).get(NEVER_LIMITED_KEY)

        async def guarded(request: Request) -> Response:
            request.state.action = action
            request.state.user = _admitted(request, action, is_limited=is_limited)
            request.state.asked = gateway_of(request).commands.asked()
            if action is not Action.STOP:  # a stop is refused for nothing that it says
                require_known_parameters(request, known)
            if takes_json:
                require_json(request)
                request.state.user = await _admitted_with_body(request, action)
            return conditional(request, sparse(request, await handler(request)))

        return guarded

    @property
    def action(self) -> Action:
        """What the route's requests do."""
        named = (self.openapi_extra or {}).get(ACTION_KEY)
        if named is None:
            raise TypeError(f"the route {self.path} names no action; give it openapi_extra=needs(Action....)")
        return Action(named)


Watch = Callable[[WebSocket], Awaitable[None]]


def guarded_websocket(action: Action) -> Callable[[Watch], Watch]:
    """The same for a WebSocket, which is closed before it is opened."""

    def decorate(watch: Watch) -> Watch:
        async def guarded(socket: WebSocket) -> None:
            try:
                socket.state.user = _admitted(socket, action, is_limited=True)
            except Refused as refusal:
                log_refusal(problem_of(refusal, socket.url.path), sender_of(socket))
                await socket.close(POLICY_VIOLATION, refusal.code)
                return
            await watch(socket)

        guarded.__doc__ = watch.__doc__
        setattr(guarded, ACTION_KEY, action)
        return guarded

    return decorate


def _admitted(connection: HTTPConnection, action: Action, *, is_limited: bool) -> User | None:
    """Who asks; raises `Refused` where he asks too often, or may not do it."""
    gateway: Gateway = connection.app.state.gateway
    token, sender = _token(connection), sender_of(connection)
    if is_limited:
        gateway.access.rate_limits.require(token, sender)
    return gateway.access.admitted(token, action, sender)


async def _admitted_with_body(request: Request, action: Action) -> User | None:
    """Who asks, once the body is there: access may end while it comes (`BODY_WITHIN_S`); raises `Refused`."""
    try:
        await request.body()
    except ClientDisconnect:
        raise HTTPException(400, "the connection ended before the body did; send the request again") from None
    return gateway_of(request).access.admitted(_token(request), action, sender_of(request))


def _token(connection: HTTPConnection) -> str | None:
    """The access token: of a program in its header, of a page in its cookie."""
    header = connection.headers.get("authorization")
    if header is None:
        return connection.cookies.get(ACCESS_COOKIE)
    return header[len(_SCHEME) :].strip() if header.lower().startswith(_SCHEME) else ""


async def _user(request: Request) -> User:
    user: User = request.state.user
    return user


async def _asked(request: Request) -> Asked:
    asked: Asked = request.state.asked
    return asked


# Only for routes whose action needs a login: elsewhere nobody may be there.
TheUser = Annotated[User, Depends(_user)]
# For what is sent to the robot: what was known when the request came.
TheAsked = Annotated[Asked, Depends(_asked)]
