"""A key for what must be verifiable elsewhere: anchors of the case record, releases. It is kept apart from both."""

import hashlib
import os
from pathlib import Path
from typing import Final, Self

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ed25519

from shared.bus.tls import require_private
from shared.errors import ConfigurationError

_REMEDY: Final = "name the key that belongs to these signatures"


class SigningKey:
    """Signs. Only `distalock record anchor` and `tools.release` have one, each its own."""

    def __init__(self, key: ed25519.Ed25519PrivateKey) -> None:
        self._key = key

    @classmethod
    def make(cls, file: Path) -> Self:
        """Make a key that only its owner can read; raises `ConfigurationError` when the file is there already."""
        key = ed25519.Ed25519PrivateKey.generate()
        pem = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
                stream.write(pem)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise ConfigurationError(f"{file} cannot be made: {error.strerror or error}") from None
        return cls(key)

    @classmethod
    def from_file(cls, file: Path) -> Self:
        """Read a key; raises `ConfigurationError` when it is missing, no such key, or can be read by others."""
        pem = _read(file)
        require_private(file)
        try:
            key = serialization.load_pem_private_key(pem, password=None)
        except (ValueError, TypeError):
            raise ConfigurationError(f"{file} is not an unencrypted private key in PEM; {_REMEDY}") from None
        if not isinstance(key, ed25519.Ed25519PrivateKey):
            raise ConfigurationError(f"{file} is not an Ed25519 key; {_REMEDY}")
        return cls(key)

    def sign(self, content: bytes) -> str:
        """Signature (RFC 8032) in hexadecimal."""
        return self._key.sign(content).hex()

    def public(self) -> "VerifyingKey":
        """What whoever verifies needs."""
        return VerifyingKey(self._key.public_key())


class VerifyingKey:
    """Verifies; nobody can sign with it."""

    def __init__(self, key: ed25519.Ed25519PublicKey) -> None:
        self._key = key

    @classmethod
    def from_file(cls, file: Path) -> Self:
        """Read a public key in PEM; raises `ConfigurationError` when there is none."""
        try:
            key = serialization.load_pem_public_key(_read(file))
        except ValueError:
            raise ConfigurationError(f"{file} is not a public key in PEM; {_REMEDY}") from None
        if not isinstance(key, ed25519.Ed25519PublicKey):
            raise ConfigurationError(f"{file} is not an Ed25519 key; {_REMEDY}")
        return cls(key)

    @property
    def sha256(self) -> str:
        """Fingerprint: SHA-256 of the raw key, in hexadecimal."""
        return hashlib.sha256(self._key.public_bytes_raw()).hexdigest()

    @property
    def pem(self) -> bytes:
        """As a file."""
        return self._key.public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)

    def has_signed(self, signature: str, content: bytes) -> bool:
        """Whether the signature is this key's over the content."""
        try:
            self._key.verify(bytes.fromhex(signature), content)
        except (InvalidSignature, ValueError):
            return False
        return True


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{file} cannot be read: {error.strerror or error}; {_REMEDY}") from None
