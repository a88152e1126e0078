"""Who somebody is, by a password: compared unless account and address are locked."""

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import structlog

from services.ui_api.access.accounts import Account, Accounts, login_failed
from services.ui_api.access.passwords import Passwords
from services.ui_api.core.lockout import Failures, Pair, after_failure, after_success, locked_for_s
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.refusals import RefusalKind, Refused

_log = structlog.stdlib.get_logger("distalock.ui_api")

# Comparing takes 0.2 s of processor time, one after another: one address cannot keep the others waiting, and all
# together leave most of the threads to other requests.
_MOST_OF_ONE_ADDRESS: Final = 2
_MOST_AT_ONCE: Final = 8
_BUSY_FOR_S: Final = 1.0


class Login:
    """Compares passwords, and counts failures by account and address."""

    def __init__(self, accounts: Accounts, passwords: Passwords, clock: Clock) -> None:
        self._accounts, self._passwords, self._clock = accounts, passwords, clock
        self._guard = threading.Lock()
        self._one_at_a_time = threading.Lock()
        self._comparing: Counter[str] = Counter()
        self._failures: dict[Pair, Failures] = {}

    def account_by_password(self, name: str, password: str, address: str) -> Account:
        """The account whose name and password these are.

        Raises
        ------
        Refused
            The same for a wrong name, a wrong password and a disabled account: which it is, is nobody's business.
        """
        with self.attempt(name, address) as failed:
            account = self._accounts.find(name)
            matches = self._passwords.matches(password, None if account is None else account.password_hash)
            if account is None or account.disabled or not matches:
                failed.set()
                raise login_failed()
            return account

    @contextmanager
    def attempt(self, name: str, address: str) -> Iterator[threading.Event]:
        """One attempt, which counts as a failure when the event is set; raises `Refused` when none is allowed."""
        pair, failed = (name, address), threading.Event()
        with self._place(address), self._one_at_a_time:
            self._require_unlocked(pair)
            try:
                yield failed
            finally:
                self._note(pair, failed=failed.is_set())

    @contextmanager
    def _place(self, address: str) -> Iterator[None]:
        with self._guard:
            if self._comparing[address] >= _MOST_OF_ONE_ADDRESS or self._comparing.total() >= _MOST_AT_ONCE:
                raise Refused(
                    RefusalKind.LOCKED,
                    "login_busy",
                    f"{self._comparing[address]} passwords from {address} and {self._comparing.total()} in all are "
                    f"being compared (limits {_MOST_OF_ONE_ADDRESS} and {_MOST_AT_ONCE}); try again",
                    _BUSY_FOR_S,
                )
            self._comparing[address] += 1
        try:
            yield
        finally:
            with self._guard:
                self._comparing[address] -= 1
                self._comparing += Counter()  # without those that are at 0

    def _require_unlocked(self, pair: Pair) -> None:
        failures = self._failures.get(pair)
        wait_s = locked_for_s(failures, self._clock.monotonic_s())
        if failures is not None and wait_s > 0.0:
            raise Refused(
                RefusalKind.LOCKED,
                "login_locked",
                f"{failures.count} passwords for '{pair[0]}' from {pair[1]} were wrong; wait {wait_s:.0f} s, or use "
                "another machine",
                wait_s,
            )

    def _note(self, pair: Pair, *, failed: bool) -> None:
        if not failed:
            self._failures = after_success(self._failures, pair)
            return
        self._failures = after_failure(self._failures, pair, self._clock.monotonic_s())
        _log.warning("login_failed", user=pair[0], address=pair[1], failures=self._failures[pair].count)
