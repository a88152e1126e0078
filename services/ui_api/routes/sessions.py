"""`/sessions`: sign in, go on, sign out. Programs get tokens, pages get cookies that no script can read."""

from typing import Final, Literal

from fastapi import APIRouter, Request, Response
from pydantic import Field

from services.ui_api.access.sessions import Tokens
from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import unauthenticated
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import ACCESS_COOKIE, GuardedRoute, TheUser, needs
from services.ui_api.routes.problems import sender_of
from services.ui_api.routes.session_bodies import LoginBody, RefreshBody
from services.ui_api.routes.views import View

router = APIRouter(prefix="/sessions", tags=["sessions"], route_class=GuardedRoute)
REFRESH_COOKIE: Final = "distalock_refresh"
_REFRESH_PATH: Final = "/api/v1/sessions"
_NO_TOKEN: Final = RefreshBody()


class SessionView(View):
    """A session. The tokens are null where they are in cookies."""

    user: str
    roles: list[str]
    access_token: str | None
    refresh_token: str | None = Field(description="Good for one renewal; used a second time, it ends the session.")
    access_expires_in_s: float
    session_expires_in_s: float


@router.post("", status_code=201, openapi_extra=needs(Action.SIGN_IN))
def sign_in(body: LoginBody, request: Request, response: Response, gateway: TheGateway) -> SessionView:
    """Open a session with name and password."""
    tokens = gateway.access.sign_in(body.name, body.password.get_secret_value(), sender_of(request))
    return _handed_over(tokens, request, response, body.keep)


@router.post("/refresh", openapi_extra=needs(Action.SIGN_IN))
def refresh_session(
    request: Request, response: Response, gateway: TheGateway, body: RefreshBody = _NO_TOKEN
) -> SessionView:
    """Renew access with the refresh token, which is replaced."""
    sent = None if body.refresh_token is None else body.refresh_token.get_secret_value()
    token = sent or request.cookies.get(REFRESH_COOKIE)
    if token is None:
        raise unauthenticated("refresh_token_invalid", "there is no refresh token, in the body or in a cookie; sign in")
    return _handed_over(gateway.access.refresh(token), request, response, "cookie" if sent is None else "bearer")


@router.delete("/current", status_code=204, openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def sign_out(gateway: TheGateway, user: TheUser) -> Response:
    """End this session and forget its cookies."""
    if user.session_id is not None:
        gateway.access.sessions.end(user.session_id)
    response = Response(status_code=204)
    response.delete_cookie(ACCESS_COOKIE)
    response.delete_cookie(REFRESH_COOKIE, path=_REFRESH_PATH)
    return response


def _handed_over(
    tokens: Tokens, request: Request, response: Response, keep: Literal["bearer", "cookie"]
) -> SessionView:
    by_cookie = keep == "cookie"
    if by_cookie:
        _set_cookie(request, response, ACCESS_COOKIE, tokens.access_token, tokens.access_s, "/")
        _set_cookie(request, response, REFRESH_COOKIE, tokens.refresh_token, tokens.session_s, _REFRESH_PATH)
    return SessionView(
        user=tokens.user.name,
        roles=sorted(tokens.user.roles),
        access_token=None if by_cookie else tokens.access_token,
        refresh_token=None if by_cookie else tokens.refresh_token,
        access_expires_in_s=tokens.access_s,
        session_expires_in_s=tokens.session_s,
    )


def _set_cookie(request: Request, response: Response, name: str, token: str, lasts_s: float, path: str) -> None:
    """A cookie that no script reads and no page of another site sends; over HTTPS alone where HTTPS is spoken."""
    response.set_cookie(
        name,
        token,
        max_age=int(lasts_s),
        path=path,
        secure=request.url.scheme == "https",
        httponly=True,
        samesite="strict",
    )
