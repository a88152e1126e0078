"""What an account's name and password must be. Pure."""

from typing import Final

# For file names, logs and URLs alike; no spaces, and nothing that two alphabets draw alike.
USER_NAME_PATTERN: Final = r"^[a-z][a-z0-9._-]{1,31}$"
LEAST_CHARACTERS: Final = 12
MOST_CHARACTERS: Final = 128
# Events that no person caused are by these.
RESERVED_NAMES: Final = frozenset({"gateway", "imaging", "registration", "robot", "ui_api", "rest"})


def name_refusal(name: str) -> str | None:
    """Why a name of an account is refused, as a sentence; the pattern was checked before."""
    if name in RESERVED_NAMES:
        return f"the name '{name}' is a service's; choose another"
    return None


def password_refusal(name: str, password: str) -> str | None:
    """Why a password is refused, as a sentence. Length counts (NIST SP 800-63B), not kinds of characters."""
    if not LEAST_CHARACTERS <= len(password) <= MOST_CHARACTERS:
        return (
            f"the password has {len(password)} characters, and must have {LEAST_CHARACTERS} to {MOST_CHARACTERS}; take "
            "several words"
        )
    if name in password.lower():
        return "the password contains the account's name; take another"
    if len(set(password)) < LEAST_CHARACTERS // 2:
        return f"the password consists of {len(set(password))} different characters; take several words"
    return None
