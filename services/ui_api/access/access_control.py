"""Who sends a request, and whether he may: everything that routes need of accounts and sessions."""

import hashlib
import hmac
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from services.ui_api.access.accounts import Account, Accounts
from services.ui_api.access.first_account import FirstAccount
from services.ui_api.access.login import Login
from services.ui_api.access.passkeys import Passkeys
from services.ui_api.access.passwords import Passwords
from services.ui_api.access.provider import Provider
from services.ui_api.access.rate_limits import RateLimits
from services.ui_api.access.sessions import SESSION_S, Sessions, Tokens
from services.ui_api.core.access_settings import DEMO_USER, AccessSettings
from services.ui_api.core.identity import Authenticated, ProviderIdentity, User
from services.ui_api.core.networks import is_in_networks
from services.ui_api.core.roles import PERMISSION_OF, Action, Role, WithoutLogin, may
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import RefusalKind, Refused, conflict, forbidden, unauthenticated, unknown
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork

DEMO_BANNER: Final = (
    "SIMULATION: whoever has the token of the user 'demo' may do everything here. Nothing in this installation is real."
)
# Chosen: long enough to fetch the phone that is to hold the passkey.
FRESH_S: Final = 300.0
_DEMO: Final = User(DEMO_USER, frozenset({Role.SURGEON, Role.ADMINISTRATOR}), Authenticated.SIMULATION_TOKEN)


class AccessControl:
    """Answers for each request who it is from, and refuses what he may not do."""

    def __init__(
        self, record: CaseRecord, clock: Clock, settings: AccessSettings, on_session_end: Callable[[], None]
    ) -> None:
        self._record, self._settings, self._clock = record, settings, clock
        self._provider = None if settings.provider is None else Provider(settings.provider, clock)
        self._demo_sha256 = None if settings.demo_token is None else _digest(settings.demo_token)
        passwords = Passwords()
        self.accounts = Accounts(record, passwords, () if self._demo_sha256 is None else (DEMO_USER,))
        self.sessions = Sessions(record, clock, on_session_end)
        self.first_account = FirstAccount(self.accounts, settings.state_dir)
        self.passkeys = Passkeys(record, self.accounts, clock, settings.passkey_host)
        self.rate_limits = RateLimits(settings.rates, clock)
        self._login = Login(self.accounts, passwords, clock)

    def start(self) -> None:
        """Offer the link for the first account; in a simulation `demo` is there already."""
        if self._demo_sha256 is None:
            self.first_account.offer()

    @property
    def has_demo_user(self) -> bool:
        """Whether this is a simulation with the user `demo`."""
        return self._demo_sha256 is not None

    def admitted(self, token: str | None, action: Action, address: str) -> User | None:
        """Who may do this; None for somebody who need not be known. Raises `Refused`."""
        if self._is_open_to(action, address):
            return self._known_user_of(token)
        user = self._user_of(token)
        if not may(user.roles, action):
            raise forbidden(
                "not_permitted",
                f"'{user.name}' is {_and(user.roles)}, and '{action}' is for {_or(PERMISSION_OF[action].roles)}",
            )
        return user

    def require_still(self, user: User, action: Action) -> None:
        """Refuse whoever has lost access since the request was admitted; raises `Refused`.

        Call it within the transaction of what is done: accounts and sessions change in transactions too, so that none
        of their changes comes between.
        """
        if user.session_id is None:
            return  # a program with the simulation's token has neither account nor session
        account = self.accounts.find(user.name)
        is_open = self.sessions.is_open(user.session_id)
        if account is None or account.disabled or not may(account.roles, action) or not is_open:
            raise unauthenticated(
                "token_invalid",
                f"the session of '{user.name}' ended while the request was worked on, and nothing was done; sign in "
                "and ask again",
            )

    def sign_in(self, name: str, password: str, address: str) -> Tokens:
        """Open a session; raises `Refused`."""
        if name == DEMO_USER and self._is_demo_token(password):
            return _demo_tokens(password)
        account = self._login.account_by_password(name, password, address)
        return self.sessions.open(lambda _: self.accounts.unchanged(account), Authenticated.PASSWORD)

    @property
    def provider(self) -> Provider:
        """The identity provider; raises `Refused` where there is none."""
        if self._provider is None:
            raise unknown("provider", "identity provider", "sign in with a password (POST /sessions)")
        return self._provider

    @property
    def provider_issuer(self) -> str | None:
        """Name of the identity provider; None where there is none."""
        return None if self._provider is None else self._provider.issuer

    def sign_in_of_provider(self, identity: ProviderIdentity) -> Tokens:
        """Open a session for somebody whom the identity provider knows; raises `Refused`.

        Who has no role there any more is refused, and his account has none here either: its sessions end.
        """
        if not identity.roles:
            with self._record.write() as unit:
                self.accounts.without_roles(unit, identity.subject, self.sessions.end_all_of)
            raise self.provider.roles_missing(identity)

        def account_now(unit: UnitOfWork) -> Account:
            return self.accounts.of_provider(unit, identity, self.sessions.end_all_of)

        return self.sessions.open(account_now, Authenticated.PROVIDER)

    def refresh(self, refresh_token: str) -> Tokens:
        """Renew a session; raises `Refused`."""
        return (
            _demo_tokens(refresh_token) if self._is_demo_token(refresh_token) else self.sessions.refresh(refresh_token)
        )

    def confirmed(self, user: User, password: str | None, address: str) -> Authenticated:
        """How a user who is signed in shows once more who he is.

        A program that brings the simulation's token brings its credential with every request.

        Raises
        ------
        Refused
            When the password is missing, wrong, or no longer tried.
        """
        if user.authenticated is Authenticated.SIMULATION_TOKEN:
            return user.authenticated
        if password is None:
            needed = "a passkey" if user.authenticated is Authenticated.PROVIDER else "the password, or a passkey,"
            raise forbidden("credential_missing", f"{needed} of '{user.name}' is missing; send it with the approval")
        try:
            self._login.account_by_password(user.name, password, address)
        except Refused as refusal:
            if refusal.kind is not RefusalKind.UNAUTHENTICATED:
                raise
            raise forbidden("credential_wrong", f"the password is not that of '{user.name}'; send it again") from None
        return Authenticated.PASSWORD

    def confirmed_by_passkey(self, user: User, plan_sha256: str, signed: Mapping[str, Any]) -> Authenticated:
        """The same with a passkey, which signs for one plan alone; raises `Refused`."""
        self.passkeys.confirm(user, plan_sha256, signed)
        return Authenticated.PASSKEY

    def require_fresh(self, user: User, password: str | None, address: str) -> Account:
        """The account of somebody who has just shown who he is, for `Accounts.unchanged`; raises `Refused`."""
        if user.name == DEMO_USER and self.has_demo_user:
            raise conflict(
                "demo_user", "the simulation's user has a token and nothing else; make an account of your own"
            )
        account = self.accounts.account(user.name)
        age_s = None if user.signed_in_s is None else self._clock.monotonic_s() - user.signed_in_s
        if user.authenticated is not Authenticated.PROVIDER:
            self.confirmed(user, password, address)
        elif age_s is None or age_s > FRESH_S:
            raise forbidden(
                "sign_in_again",
                f"'{user.name}' has no password, and signed in more than {FRESH_S:g} s ago; sign in again, then go on",
            )
        return account

    def still_admits(self, user: User | None) -> bool:
        """Whether a stream that somebody opened may go on."""
        return user is None or user.session_id is None or self.sessions.is_open(user.session_id)

    def _is_open_to(self, action: Action, address: str) -> bool:
        match PERMISSION_OF[action].without_login:
            case WithoutLogin.ANYBODY:
                return True
            case WithoutLogin.ROOM:
                return is_in_networks(address, self._settings.room_networks)
            case WithoutLogin.NOBODY:
                return False

    def _user_of(self, token: str | None) -> User:
        if token is None:
            raise unauthenticated(
                "token_missing", "nobody is signed in; sign in (POST /sessions) and send the access token"
            )
        return _DEMO if self._is_demo_token(token) else self.sessions.user_of(token)

    def _known_user_of(self, token: str | None) -> User | None:
        """Who it is, where nobody need be known: a token that has expired keeps nobody from a stop."""
        try:
            return None if token is None else self._user_of(token)
        except Refused:
            return None

    def _is_demo_token(self, token: str) -> bool:
        return self._demo_sha256 is not None and hmac.compare_digest(_digest(token), self._demo_sha256)


def _demo_tokens(token: str) -> Tokens:
    """The simulation's token is all that `demo` has, and lasts as long as the simulation."""
    return Tokens(_DEMO, token, token, SESSION_S, SESSION_S)


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()


def _and(roles: Iterable[Role]) -> str:
    return " and ".join(sorted(roles))


def _or(roles: Iterable[Role]) -> str:
    return " or ".join(sorted(roles))
