"""`/users/me/passkeys`: passkeys of the own account, and the challenge that one signs to approve a plan."""

from typing import Annotated, Any

from fastapi import Request, Response
from pydantic import Field

from services.ui_api.access.passkeys import CHALLENGE_S, Passkey
from services.ui_api.core.roles import Action
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.bodies import Body, Password, SignedByPasskey
from services.ui_api.routes.guards import TheUser, needs
from services.ui_api.routes.problems import sender_of
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.transactions import TheWrite
from services.ui_api.routes.views import View
from shared.messages.base import Sha256, UnixNanoseconds

router = resource_router("/users", tag="users")


class PasskeyView(View):
    """A passkey, without its key."""

    id: str
    label: str
    created_at_ns: UnixNanoseconds

    @staticmethod
    def of(passkey: Passkey) -> "PasskeyView":
        """What may be seen of it."""
        return PasskeyView(id=passkey.id, label=passkey.label, created_at_ns=passkey.created_at_ns)


class PasskeysView(View):
    """All passkeys of the own account, the oldest first."""

    items: list[PasskeyView]


class PasskeyOptions(View):
    """What a page hands to `navigator.credentials`, in the JSON form of WebAuthn Level 3."""

    public_key: dict[str, Any]
    expires_in_s: float


class ChallengeBody(Body):
    """Which plan is to be approved: the passkey signs for this one alone."""

    plan_sha256: Sha256


class PasskeyBody(Body):
    """A new passkey, with the password once more: a session that was left open registers none."""

    label: Annotated[str, Field(min_length=1, max_length=64, description="For people: which phone or key it is in.")]
    password: Password | None = Field(
        None, description="The own one. Not needed in the first five minutes after signing in with a provider."
    )
    credential: SignedByPasskey


@router.get("/me/passkeys", openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def list_passkeys(gateway: TheGateway, user: TheUser) -> PasskeysView:
    """Passkeys of the own account."""
    return PasskeysView(items=[PasskeyView.of(one) for one in gateway.access.passkeys.of(user.name)])


@router.post("/me/passkeys/registration", openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def begin_passkey(gateway: TheGateway, user: TheUser) -> PasskeyOptions:
    """Options to make a passkey with; then `POST /users/me/passkeys`."""
    return PasskeyOptions(public_key=gateway.access.passkeys.registration(user), expires_in_s=CHALLENGE_S)


@router.post("/me/passkeys", status_code=201, openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def add_passkey(
    request: Request, body: PasskeyBody, gateway: TheGateway, write: TheWrite, user: TheUser
) -> PasskeyView:
    """Keep a new passkey."""
    password = None if body.password is None else body.password.get_secret_value()
    access = gateway.access
    account = access.require_fresh(user, password, sender_of(request))
    passkey = access.passkeys.made(user, body.label, body.credential)
    with write() as unit:
        access.accounts.unchanged(account)
        access.passkeys.add(unit, passkey)
    return PasskeyView.of(passkey)


@router.post("/me/passkeys/challenge", openapi_extra=needs(Action.APPROVE_PLAN))
def ask_challenge(body: ChallengeBody, gateway: TheGateway, user: TheUser) -> PasskeyOptions:
    """Options to sign the approval of one plan with; then `POST .../approval` with `passkey`."""
    return PasskeyOptions(
        public_key=gateway.access.passkeys.challenge(user, body.plan_sha256), expires_in_s=CHALLENGE_S
    )


@router.delete("/me/passkeys/{passkey_id}", status_code=204, openapi_extra=needs(Action.USE_OWN_ACCOUNT))
def remove_passkey(passkey_id: str, gateway: TheGateway, write: TheWrite, user: TheUser) -> Response:
    """Forget a passkey of the own account."""
    with write() as unit:
        gateway.access.passkeys.remove(unit, user.name, passkey_id, user.name)
    return Response(status_code=204)


@router.delete("/{name}/passkeys", status_code=204, openapi_extra=needs(Action.ADMINISTER_USERS))
def remove_passkeys_of_user(name: str, gateway: TheGateway, write: TheWrite, user: TheUser) -> Response:
    """Forget all passkeys of a user: a phone was lost."""
    with write() as unit:
        gateway.access.passkeys.remove_all(unit, name, user.name)
    return Response(status_code=204)
