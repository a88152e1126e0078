"""Which account and which roles the claims of an identity provider stand for. Pure."""

import re
from collections.abc import Mapping
from typing import Any, Final

from services.ui_api.core.access_settings import ProviderSettings
from services.ui_api.core.account_rules import USER_NAME_PATTERN
from services.ui_api.core.identity import ProviderIdentity
from services.ui_api.handlers.refusals import Refused, forbidden

_MOST_CHARACTERS: Final = 32  # as the pattern has it
_NOT_IN_NAMES: Final = re.compile(r"[^a-z0-9._-]+")


def identity_of_claims(claims: Mapping[str, Any], settings: ProviderSettings) -> ProviderIdentity:
    """Account name and roles by the settings' claims. A name that no account can have counts where one is to be made.

    Who has no role is known nevertheless: an account of his must lose those that it has (`roles_missing`).
    """
    groups = claims.get(settings.roles_claim, ())
    groups = [groups] if isinstance(groups, str) else groups
    there = tuple(str(group) for group in groups) if isinstance(groups, list | tuple) else ()
    roles = frozenset(settings.roles[group] for group in there if group in settings.roles)
    stated = claims.get(settings.name_claim)
    name = _NOT_IN_NAMES.sub(".", str(stated or "").split("@", 1)[0].lower()).strip(".")[:_MOST_CHARACTERS]
    name_refusal = None
    if not re.match(USER_NAME_PATTERN, name):
        name_refusal = (
            f"the claim '{settings.name_claim}' is {str(stated)[:80]!r}, and an account needs a name of 2 to "
            f"{_MOST_CHARACTERS} letters, digits, dots and dashes; set another claim, or have it set"
        )
    return ProviderIdentity(f"{settings.issuer} {claims['sub']}", name, roles, there, name_refusal)


def roles_missing(identity: ProviderIdentity, settings: ProviderSettings) -> Refused:
    """Refusal of somebody without a role."""
    return forbidden(
        "provider_roles_missing",
        f"'{identity.name or identity.subject}' has no role here: the claim '{settings.roles_claim}' has "
        f"{', '.join(identity.groups)[:120] or 'nothing'}, and roles come from {', '.join(settings.roles)[:120]}; ask "
        "an administrator",
    )
