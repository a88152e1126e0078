"""The key with which the gateway signs permits to move, and the certificate by which the robot knows it.

The gateway alone has the private key. The robot has the key's certificate, which must be signed by the installation's
authority and be for this use: with neither the key of a service nor a certificate for something else can a permit be
made. Both are read once, at the start.
"""

import hashlib
from datetime import datetime
from pathlib import Path
from typing import Final, Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ed25519

from shared.bus.tls import require_private
from shared.errors import ConfigurationError
from shared.messages.base import encode
from shared.messages.permits import Permit, SignedPermit
from shared.pki.authority import CertificateFacts, Use, is_for, is_issued_by
from shared.pki.private_files import read_file

PERMIT_KEY_FILE: Final = "permit_key.pem"
PERMIT_CERTIFICATE_FILE: Final = "permit_certificate.pem"
_REMEDY: Final = "make it (distalock pki init) and start the installation again"


class PermitSigner:
    """Signs permits. For the gateway."""

    def __init__(self, key: ed25519.Ed25519PrivateKey) -> None:
        self._key = key
        self.key_sha256 = _key_sha256(key.public_key())

    @classmethod
    def from_file(cls, file: Path) -> Self:
        """Read the private key; raises `ConfigurationError` when it is missing, unreadable or not private."""
        if not file.is_file():
            raise ConfigurationError(f"{file} is missing: without it no permit to move can be signed; {_REMEDY}")
        require_private(file)
        try:
            key = serialization.load_pem_private_key(read_file(file), password=None)
        except (ValueError, TypeError):
            raise ConfigurationError(f"{file} is not an unencrypted private key in PEM; {_REMEDY}") from None
        if not isinstance(key, ed25519.Ed25519PrivateKey):
            raise ConfigurationError(f"{file} is not an Ed25519 key; {_REMEDY}")
        return cls(key)

    def sign(self, permit: Permit) -> SignedPermit:
        """The permit as it travels: its text, and the signature over it."""
        content = encode(permit)
        return SignedPermit(
            permit_json=content.decode(),
            permit_sha256=hashlib.sha256(content).hexdigest(),
            key_sha256=self.key_sha256,
            signature=self._key.sign(content).hex(),
        )


class PermitVerifier:
    """Knows the gateway's signature. For the robot."""

    def __init__(self, key: ed25519.Ed25519PublicKey) -> None:
        self._key = key
        self.key_sha256 = _key_sha256(key)

    @classmethod
    def from_files(cls, certificate_file: Path, authority_file: Path, now: datetime) -> Self:
        """Read the key from its certificate.

        Raises
        ------
        ConfigurationError
            When a file is missing, or the certificate is not one for permits that the authority has signed and that is
            valid now.
        """
        certificate, authority = _read(certificate_file), _read(authority_file)
        facts = CertificateFacts.of(certificate)
        if not is_issued_by(authority, certificate):
            raise ConfigurationError(
                f"{certificate_file} is not signed by the authority in {authority_file}; {_REMEDY}"
            )
        if not is_for(certificate, Use.PERMIT):
            raise ConfigurationError(f"{certificate_file} is not a certificate for permits to move; {_REMEDY}")
        if not facts.not_before <= now <= facts.not_after:
            raise ConfigurationError(
                f"{certificate_file} is valid from {facts.not_before:%Y-%m-%d} to {facts.not_after:%Y-%m-%d}, and "
                f"today is {now:%Y-%m-%d}; {_REMEDY}"
            )
        key = x509.load_pem_x509_certificate(certificate).public_key()
        if not isinstance(key, ed25519.Ed25519PublicKey):
            raise ConfigurationError(f"{certificate_file} is not the certificate of an Ed25519 key; {_REMEDY}")
        return cls(key)

    def has_signed(self, signed: SignedPermit) -> bool:
        """Whether the signature is that of the gateway's key over the permit's text."""
        try:
            self._key.verify(bytes.fromhex(signed.signature), signed.permit_json.encode())
        except InvalidSignature:
            return False
        return True


def _key_sha256(key: ed25519.Ed25519PublicKey) -> str:
    return hashlib.sha256(key.public_bytes_raw()).hexdigest()


def _read(file: Path) -> bytes:
    if not file.is_file():
        raise ConfigurationError(f"{file} is missing: without it no permit to move can be verified; {_REMEDY}")
    return read_file(file)
