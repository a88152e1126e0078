"""`/sessions`: sign in, go on, sign out. Programs get tokens, pages get cookies that no script can read."""

from typing import Annotated, Any, Final, Literal

from fastapi import Query, Request, Response
from pydantic import Field

from services.ui_api.access.provider import ROUND_TRIP_S
from services.ui_api.access.sessions import Tokens
from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import unauthenticated
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.bodies import Body
from services.ui_api.routes.guards import ACCESS_COOKIE, TheUser, needs
from services.ui_api.routes.problems import sender_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.session_bodies import LoginBody, RefreshBody
from services.ui_api.routes.views import View

router = resource_router("/sessions", tag="sessions")
REFRESH_COOKIE: Final = "distalock_refresh"
_REFRESH_PATH: Final = "/api/v1/sessions"
_NO_TOKEN: Final = RefreshBody()
_PROVIDER_COOKIE: Final = "distalock_provider"
_REDIRECT: Final[dict[int | str, dict[str, Any]]] = {
    303: {"description": "The browser goes on to `Location`.", "headers": {"Location": {"schema": {"type": "string"}}}}
}


class SessionView(View):
    """A session. The tokens are null where they are in cookies."""

    user: str
    roles: list[str]
    access_token: str | None
    refresh_token: str | None = Field(description="Good for one renewal; used a second time, it ends the session.")
    access_expires_in_s: float
    session_expires_in_s: float


class WaysView(View):
    """How one can sign in: with name and password (`POST /sessions`), and where there is one with a provider."""

    provider: str | None = Field(
        description="The identity provider's name; browsers go to GET /sessions/provider. Null where there is none."
    )


class Returned(Body):
    """What an identity provider gives a browser to bring back; some add a name of theirs, which is not used."""

    state: Annotated[str, Field(min_length=1, max_length=256)]
    code: Annotated[str, Field(max_length=4096)] | None = None
    error: Annotated[str, Field(max_length=256)] | None = None
    error_description: Annotated[str, Field(max_length=2048)] | None = None
    error_uri: Annotated[str, Field(max_length=2048)] | None = None
    iss: Annotated[str, Field(max_length=512)] | None = None
    session_state: Annotated[str, Field(max_length=512)] | None = None
    scope: Annotated[str, Field(max_length=512)] | None = None


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


@router.get("/ways", openapi_extra=needs(Action.SIGN_IN))
def read_ways(gateway: TheGateway) -> WaysView:
    """How one can sign in here."""
    return WaysView(provider=gateway.access.provider_issuer)


@router.get(
    "/provider", status_code=303, response_class=Response, responses=_REDIRECT, openapi_extra=needs(Action.SIGN_IN)
)
def depart_to_provider(request: Request, gateway: TheGateway) -> Response:
    """Send a browser to the identity provider, from where it comes back signed in."""
    departure = gateway.access.provider.depart(_return_url(request))
    response = Response(status_code=303, headers={"Location": departure.url})
    # lax: the way back begins at the provider's page
    response.set_cookie(
        _PROVIDER_COOKIE,
        departure.browser_secret,
        max_age=int(ROUND_TRIP_S),
        path=_REFRESH_PATH,
        secure=request.url.scheme == "https",
        httponly=True,
        samesite="lax",
    )
    return response


@router.get(
    "/provider/return",
    status_code=303,
    response_class=Response,
    responses=_REDIRECT,
    openapi_extra=needs(Action.SIGN_IN),
)
def return_from_provider(request: Request, returned: Annotated[Returned, Query()], gateway: TheGateway) -> Response:
    """Take in a browser that comes back from the identity provider; the session is in its cookies."""
    access = gateway.access
    if returned.code is None:
        why = (returned.error_description or returned.error or "it gave no reason")[:120]
        raise unauthenticated("provider_refused", f"the identity provider let nobody in ({why}); sign in again")
    browser = request.cookies.get(_PROVIDER_COOKIE, "")
    identity = access.provider.arrive(returned.state, returned.code, browser, _return_url(request))
    tokens = access.sign_in_of_provider(identity)
    response = Response(status_code=303, headers={"Location": "/"})
    _set_cookies(request, response, tokens)
    response.delete_cookie(_PROVIDER_COOKIE, path=_REFRESH_PATH)
    return response


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
        _set_cookies(request, response, tokens)
    return SessionView(
        user=tokens.user.name,
        roles=sorted(tokens.user.roles),
        access_token=None if by_cookie else tokens.access_token,
        refresh_token=None if by_cookie else tokens.refresh_token,
        access_expires_in_s=tokens.access_s,
        session_expires_in_s=tokens.session_s,
    )


def _return_url(request: Request) -> str:
    """Where the provider sends browsers back to: the very name by which this one called, which was checked."""
    return f"{request.url.scheme}://{request.url.netloc}{_REFRESH_PATH}/provider/return"


def _set_cookies(request: Request, response: Response, tokens: Tokens) -> None:
    _set_cookie(request, response, ACCESS_COOKIE, tokens.access_token, tokens.access_s, "/")
    _set_cookie(request, response, REFRESH_COOKIE, tokens.refresh_token, tokens.session_s, _REFRESH_PATH)


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
