"""`/setup`: the page behind the one-time link with which the first account is made. It runs no script."""

import html
from typing import Annotated, Any, Final
from urllib.parse import parse_qs

from fastapi import Depends, Query, Request, Response
from pydantic import ValidationError

from services.ui_api.core.account_rules import LEAST_CHARACTERS
from services.ui_api.core.roles import Action
from services.ui_api.handlers.refusals import RefusalKind, Refused, invalid
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.session_bodies import FirstAccountBody

router = resource_router("/setup", tag="first account")
SetupToken = Annotated[str, Query(min_length=1, max_length=128, description="From the link.")]
_FORM: Final = "application/x-www-form-urlencoded"
_HTML: Final[dict[int | str, dict[str, Any]]] = {200: {"content": {"text/html": {}}}}
# As on every other answer, but that this page's own form may be sent.
_POLICY: Final = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
_BODY: Final = {"requestBody": {"required": True, "content": {_FORM: {"schema": FirstAccountBody.model_json_schema()}}}}


async def _sent_form(request: Request) -> FirstAccountBody:
    """The form's fields; raises `Refused`."""
    fields = parse_qs((await request.body()).decode("utf-8", "replace"), keep_blank_values=True)
    try:
        return FirstAccountBody.model_validate({name: values[0] for name, values in fields.items()})
    except ValidationError as error:
        first = error.errors()[0]
        raise invalid("request_invalid", f"{'.'.join(str(one) for one in first['loc'])}: {first['msg']}") from None


@router.get("", response_class=Response, responses=_HTML, openapi_extra=needs(Action.SIGN_IN))
def show_setup_page(token: SetupToken, gateway: TheGateway) -> Response:
    """The page for the first account, by its one-time link."""
    gateway.access.first_account.require(token)
    return _page(_form(token, ""))


@router.post("", response_class=Response, responses=_HTML, openapi_extra=needs(Action.SIGN_IN) | _BODY)
def create_first_account(
    token: SetupToken, body: Annotated[FirstAccountBody, Depends(_sent_form)], gateway: TheGateway
) -> Response:
    """Make the first account, an administrator. The link is used up."""
    access = gateway.access
    access.first_account.require(token)
    try:
        hashed = access.accounts.hashed(body.name, body.password.get_secret_value())
        with gateway.record.write() as unit:
            access.first_account.create(unit, token, body.name, hashed)
    except Refused as refusal:
        if refusal.kind is not RefusalKind.INVALID:
            raise
        return _page(_form(token, str(refusal)), 422)
    return _page(
        f"<p>The account <b>{html.escape(body.name)}</b> is there. Sign in, and make an account for each "
        "surgeon and technician: an administrator administers, and moves nothing.</p>"
    )


def _form(token: str, refusal: str) -> str:
    why = f"<p role='alert'><b>{html.escape(refusal)}</b></p>" if refusal else ""
    return (
        "<p>Nobody can sign in yet. Make the account of the first administrator; this link then ends.</p>"
        f"{why}<form method='post' action='?token={html.escape(token, quote=True)}'>"
        "<p><label>Name <input name='name' autocomplete='username' required></label> "
        "small letters, digits, '.', '_' and '-', 2 to 32</p>"
        "<p><label>Password <input name='password' type='password' autocomplete='new-password' required></label> "
        f"at least {LEAST_CHARACTERS} characters: several words</p>"
        "<p><button>Make the account</button></p></form>"
    )


def _page(content: str, status: int = 200) -> Response:
    page = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><title>distalock: first account</title></head>"
        f"<body><h1>distalock: first account</h1>{content}</body></html>"
    )
    return Response(page, status, {"content-security-policy": _POLICY}, media_type="text/html")
