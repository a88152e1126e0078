"""`/users`: the own account, and the administration of all. Every change stands in the log."""

from fastapi import Request, Response
from pydantic import Field

from services.ui_api.access.access_control import DEMO_BANNER
from services.ui_api.access.accounts import Account, note_change
from services.ui_api.core.access_settings import DEMO_USER
from services.ui_api.core.account_event_data import AccountChange
from services.ui_api.core.roles import PERMISSIONS, Action, may
from services.ui_api.handlers.refusals import conflict
from services.ui_api.record.unit_of_work import Answer, UnitOfWork
from services.ui_api.routes.access import TheGateway, TheIdempotency
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.idempotency import IdempotencyKey, json_answer, keyed
from services.ui_api.routes.pages import Cursor, Limit, Page, page
from services.ui_api.routes.problems import sender_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.session_bodies import PasswordBody, UserBody, UserPatch, roles_of
from services.ui_api.routes.transactions import TheWrite
from services.ui_api.routes.views import View
from services.ui_api.service import Gateway
from shared.messages.base import UnixNanoseconds

router = resource_router("/users", tag="users")


class MeView(View):
    """Who is signed in, and what he may do."""

    name: str
    roles: list[str]
    actions: list[str]
    authenticated_by: str = Field(description="`password`, or `simulation_token` in a simulation.")
    banner: str | None = Field(description="What every page must show at all times; null outside simulations.")


class UserView(View):
    """An account."""

    name: str
    roles: list[str]
    disabled: bool
    created_at_ns: UnixNanoseconds

    @staticmethod
    def of(account: Account) -> "UserView":
        """Without its secret."""
        return UserView(
            name=account.name,
            roles=sorted(account.roles),
            disabled=account.disabled,
            created_at_ns=account.created_at_ns,
        )


@router.get("/me", openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def read_me(gateway: TheGateway, user: TheUser) -> MeView:
    """Who is signed in."""
    return MeView(
        name=user.name,
        roles=sorted(user.roles),
        actions=[str(one.action) for one in PERMISSIONS if may(user.roles, one.action)],
        authenticated_by=str(user.authenticated),
        banner=DEMO_BANNER if gateway.access.has_demo_user else None,
    )


@router.put("/me/password", status_code=204, openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def change_own_password(
    request: Request, body: PasswordBody, gateway: TheGateway, write: TheWrite, user: TheUser
) -> Response:
    """Change the own password, with the old one; other sessions end."""
    if user.name == DEMO_USER and gateway.access.has_demo_user:
        raise conflict("demo_user", "the simulation's user has a token and no password; make an account of your own")
    before = gateway.access.accounts.account(user.name)
    gateway.access.confirmed(user, body.password.get_secret_value(), sender_of(request))
    hashed = gateway.access.accounts.hashed(user.name, body.new_password.get_secret_value())
    with write() as unit:
        gateway.access.accounts.unchanged(before)  # the old password may be none any more
        gateway.access.accounts.set_password(unit, user.name, hashed, user.name)
        gateway.access.sessions.end_all_of(unit, user.name, but=user.session_id)
    return Response(status_code=204)


@router.get("", openapi_extra=needs(Action.ADMINISTER_USERS))
def list_users(gateway: TheGateway, cursor: Cursor = None, limit: Limit = 50) -> Page[UserView]:
    """All accounts, by name."""
    return page(gateway.access.accounts.all(), cursor, limit, UserView.of)


@router.get("/{name}", openapi_extra=needs(Action.ADMINISTER_USERS))
def read_user(name: str, gateway: TheGateway) -> UserView:
    """One account."""
    return UserView.of(gateway.access.accounts.account(name))


@router.post("", status_code=201, response_model=UserView, openapi_extra=needs(Action.ADMINISTER_USERS))
def create_user(
    request: Request,
    body: UserBody,
    key: IdempotencyKey,
    gateway: TheGateway,
    idempotency: TheIdempotency,
    user: TheUser,
) -> Response:
    """Make an account."""
    accounts, roles = gateway.access.accounts, roles_of(body.roles)

    def act(unit: UnitOfWork, hashed: str) -> Answer:
        account = Account(body.name, roles, hashed, disabled=False, created_at_ns=unit.now_ns)
        accounts.create(unit, account, user.name)
        return json_answer(201, UserView.of(account), location=f"/api/v1/users/{body.name}")

    def ask() -> str:
        return accounts.hashed(body.name, body.password.get_secret_value())

    return idempotency.once_after(keyed(request, key, body), ask, act)


@router.patch("/{name}", openapi_extra=needs(Action.ADMINISTER_USERS))
def change_user(name: str, body: UserPatch, gateway: TheGateway, write: TheWrite, user: TheUser) -> UserView:
    """Change roles or password, disable or enable; the user's sessions end."""
    accounts = gateway.access.accounts
    hashed = None if body.password is None else accounts.hashed(name, body.password.get_secret_value())
    with write() as unit:
        _change(gateway, unit, name, body, hashed, user.name)
    return read_user(name, gateway)


@router.delete("/{name}/sessions", status_code=204, openapi_extra=needs(Action.ADMINISTER_USERS))
def end_sessions(name: str, gateway: TheGateway, write: TheWrite, user: TheUser) -> Response:
    """End all sessions of a user now."""
    account = gateway.access.accounts.account(name)
    with write() as unit:
        note_change(unit, name, AccountChange.SESSIONS_ENDED, account.roles, user.name)
        gateway.access.sessions.end_all_of(unit, name)
    return Response(status_code=204)


def _change(gateway: Gateway, unit: UnitOfWork, name: str, body: UserPatch, hashed: str | None, who: str) -> None:
    accounts = gateway.access.accounts
    accounts.account(name)
    if body.roles is not None:
        accounts.set_roles(unit, name, roles_of(body.roles), who)
    if hashed is not None:
        accounts.set_password(unit, name, hashed, who)
    if body.disabled is not None:
        accounts.set_disabled(unit, name, who, disabled=body.disabled)
    gateway.access.sessions.end_all_of(unit, name)
