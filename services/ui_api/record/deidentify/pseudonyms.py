"""Names that replace others, alike everywhere in one export and never the same in two."""

import hashlib
import hmac
import re
import secrets
from typing import Final

SHA256: Final = re.compile(r"[0-9a-f]{64}")
_SERVICES: Final = frozenset({"gateway", "imaging", "registration", "robot"})
# UIDs derived from UUIDs (ISO/IEC 9834-8): anybody may use them.
_UUID_ROOT: Final = "2.25."


class Pseudonyms:
    """Derived with a key that is drawn once and kept nowhere: nobody can find back, nor try what might have been."""

    def __init__(self) -> None:
        self._key = secrets.token_bytes(32)
        self._people: dict[str, str] = {}

    def sha256(self, name: str) -> str:
        """In place of a hash, which would tell whoever has the original that this is it."""
        return hmac.new(self._key, name.encode(), hashlib.sha256).hexdigest()

    def name(self, name: str) -> str:
        """In place of an identifier."""
        return self.sha256(name)[:16] if name else ""

    def uid(self, uid: str) -> str:
        """In place of a DICOM UID."""
        return f"{_UUID_ROOT}{int(self.sha256(uid)[:32], 16)}" if uid else ""

    def person(self, name: str) -> str:
        """In place of a person, numbered as they appear; services are no people."""
        if not name or name in _SERVICES:
            return name
        return self._people.setdefault(name, f"person-{len(self._people) + 1}")
