"""Settings of access control. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from services.ui_api.core.networks import Network
from services.ui_api.core.rate_limit import NO_LIMITS, RateSettings
from services.ui_api.core.roles import Role

DEMO_USER: Final = "demo"
# Beside the record: the path of the one-time link for the first account, while there is none.
SETUP_FILE: Final = "set-up-link"


@dataclass(frozen=True, slots=True)
class ProviderSettings:
    """An identity provider of the hospital.

    Attributes
    ----------
    issuer
        Its name, which is a URL.
    client_secret
        None of a client that has none; PKCE is used either way.
    roles
        Roles by the values of the claim `roles_claim`.
    """

    issuer: str
    client_id: str
    client_secret: str | None
    scope: str
    name_claim: str
    roles_claim: str
    roles: Mapping[str, Role]


@dataclass(frozen=True, slots=True)
class AccessSettings:
    """Settings of access control.

    Attributes
    ----------
    demo_token
        Token and password of the user `demo`, in a simulation; None where there is no such user.
    passkey_host
        Name under which browsers call the gateway: passkeys are bound to it.
    provider
        The hospital's identity provider; None where there is none.
    """

    state_dir: Path
    room_networks: tuple[Network, ...]
    demo_token: str | None
    passkey_host: str
    provider: ProviderSettings | None
    rates: RateSettings = NO_LIMITS
