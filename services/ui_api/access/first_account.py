"""The first account: made by whoever has the one-time link that the gateway shows while there is none."""

import hashlib
import hmac
import secrets
from pathlib import Path
from typing import Final

import structlog

from services.ui_api.access.accounts import Account, Accounts
from services.ui_api.core.access_settings import SETUP_FILE
from services.ui_api.core.roles import Role
from services.ui_api.handlers.refusals import forbidden
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.pki.private_files import write_private

_log = structlog.stdlib.get_logger("distalock.ui_api")

SETUP_PATH: Final = "/api/v1/setup"


class FirstAccount:
    """Holds the link until there is an account, whoever made it.

    Parameters
    ----------
    state_dir
        Where the file with the link's path is written, for its owner's eyes only.
    """

    def __init__(self, accounts: Accounts, state_dir: Path) -> None:
        self._accounts, self._file = accounts, state_dir / SETUP_FILE
        self._token_sha256: bytes | None = None
        accounts.on_create = self._withdraw

    def offer(self) -> None:
        """Write a new link while there is no account; forget an old one otherwise."""
        if not self._accounts.are_there_none():
            self._withdraw()
            return
        token = secrets.token_urlsafe(32)
        self._token_sha256 = hashlib.sha256(token.encode()).digest()
        path = f"{SETUP_PATH}?token={token}"
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_private(self._file, f"{path}\n".encode())
        _log.warning("no_account", detail="nobody can sign in yet; open this once to make the first account", link=path)

    def require(self, token: str) -> None:
        """Refuse whoever has not the link, and everybody once there is an account; raises `Refused`."""
        given, kept = hashlib.sha256(token.encode()).digest(), self._token_sha256
        if kept is None or not hmac.compare_digest(given, kept) or not self._accounts.are_there_none():
            raise forbidden(
                "setup_link_invalid",
                "there is an account already, or the link is of an earlier start; an administrator makes further "
                "accounts, and as long as there is none the newest link is in the file set-up-link of the state folder",
            )

    def create(self, unit: UnitOfWork, token: str, name: str, password_hash: str) -> None:
        """Make the first account, an administrator, which withdraws the link; raises `Refused`."""
        self.require(token)  # once more, for transactions come one after another
        account = Account(name, frozenset({Role.ADMINISTRATOR}), password_hash, disabled=False, created_at_ns=0)
        self._accounts.create(unit, account, name)

    def _withdraw(self) -> None:
        self._token_sha256 = None
        self._file.unlink(missing_ok=True)
