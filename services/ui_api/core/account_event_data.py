"""What the log says of accounts and sessions: names and changes, never a secret."""

from dataclasses import dataclass
from enum import StrEnum


class AccountChange(StrEnum):
    """What happened to an account."""

    CREATED = "created"
    ROLES_CHANGED = "roles_changed"
    PASSWORD_CHANGED = "password_changed"  # noqa: S105 - the name of a change
    DISABLED = "disabled"
    ENABLED = "enabled"
    PASSKEY_ADDED = "passkey_added"
    PASSKEY_REMOVED = "passkey_removed"
    SESSIONS_ENDED = "sessions_ended"
    REFRESH_TOKEN_REUSED = "refresh_token_reused"  # noqa: S105 - likewise


@dataclass(frozen=True, slots=True)
class AccountChanged:
    """An account was changed. `roles` are those from now on."""

    user_name: str
    change: AccountChange
    roles: tuple[str, ...]
