"""Passwords: kept as Argon2id hashes (RFC 9106), compared one at a time."""

import threading
from typing import Final

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

# RFC 9106, 4: three passes over 64 MiB where memory is short; one lane in place of four, so that a guesser keeps one
# processor busy and leaves the others alone.
_PASSES: Final = 3
_MEMORY_KIB: Final = 64 * 1024
_LANES: Final = 1
# What is compared where there is no account: as long as with one, so that names cannot be guessed by time.
_NOBODYS_PASSWORD: Final = "no account has this password"  # noqa: S105 - it opens nothing


class Passwords:
    """Hashes and compares. One at a time: a robot and its stop are on the same machine."""

    def __init__(self) -> None:
        self._hasher = PasswordHasher(time_cost=_PASSES, memory_cost=_MEMORY_KIB, parallelism=_LANES)
        self._one_at_a_time = threading.Lock()
        self._nobodys: str | None = None

    def hashed(self, password: str) -> str:
        """The hash to keep, with its salt and parameters."""
        with self._one_at_a_time:
            return self._hasher.hash(password)

    def matches(self, password: str, kept_hash: str | None) -> bool:
        """Whether a password is the one that was hashed; False, after the same time, where there is no hash."""
        if kept_hash is None:
            self._compare(password, self._hash_of_nobody())
            return False
        return self._compare(password, kept_hash)

    def _compare(self, password: str, kept_hash: str) -> bool:
        with self._one_at_a_time:
            try:
                return self._hasher.verify(kept_hash, password)
            except (VerificationError, InvalidHashError):
                return False

    def _hash_of_nobody(self) -> str:
        if self._nobodys is None:
            self._nobodys = self.hashed(_NOBODYS_PASSWORD)
        return self._nobodys
