"""Who sends a request, and how that was shown. Pure."""

from dataclasses import dataclass
from enum import StrEnum

from services.ui_api.core.roles import Role


class Authenticated(StrEnum):
    """How somebody has shown who he is."""

    PASSWORD = "password"  # noqa: S105 - the name of a method
    PASSKEY = "passkey"
    PROVIDER = "provider"
    SIMULATION_TOKEN = "simulation_token"  # noqa: S105 - likewise


@dataclass(frozen=True, slots=True)
class Approver:
    """Who stands for a motion, and how that was shown for this very motion."""

    name: str
    authenticated: Authenticated


@dataclass(frozen=True, slots=True)
class ProviderIdentity:
    """Somebody whom an identity provider knows.

    Attributes
    ----------
    subject
        Issuer and subject, the name that never changes.
    roles
        Those that his groups stand for; empty when none of them stands for one.
    name_refusal
        Why no account can be made with the name, as a sentence; None where one can. An account that is there is found
        by the subject, whatever the name is now.
    groups
        What the provider's claim of roles has.
    """

    subject: str
    name: str
    roles: frozenset[Role]
    groups: tuple[str, ...] = ()
    name_refusal: str | None = None


@dataclass(frozen=True, slots=True)
class User:
    """Somebody who is signed in.

    Attributes
    ----------
    session_id
        The session; None of a program that brings the simulation's token with each request.
    signed_in_s
        When on the monotonic clock; None of before the gateway's start.
    """

    name: str
    roles: frozenset[Role]
    authenticated: Authenticated
    session_id: str | None = None
    signed_in_s: float | None = None
