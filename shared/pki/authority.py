"""Keys and certificates as values: a private authority, and what it issues. No files, no clock.

Keys are ECDSA on P-256, certificates X.509 version 3 signed with SHA-256. A certificate states what it may be used for:
the router answers connections (server), every service makes them (client), the permit key signs permits to move. The
key of a service therefore cannot pass for the router, nor sign a permit. The permit key is Ed25519: its signatures need
no random numbers, and TLS takes no such key by mistake.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import Enum
from ipaddress import ip_address
from typing import Final, Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID, ObjectIdentifier

from shared.errors import ConfigurationError

AUTHORITY_NAME: Final = "distalock authority"
# Chosen: longer than an installation's life; certificates are renewed before their year ends.
AUTHORITY_VALID: Final = timedelta(days=3650)
CERTIFICATE_VALID: Final = timedelta(days=365)
# Clocks of hosts in one room may differ; a certificate made now is valid for those that are behind, too.
_VALID_BEFORE_NOW: Final = timedelta(hours=1)


PrivateKey = ec.EllipticCurvePrivateKey | ed25519.Ed25519PrivateKey
PublicKey = ec.EllipticCurvePublicKey | ed25519.Ed25519PublicKey


class Use(Enum):
    """What a certificate may be used for."""

    SERVER = ExtendedKeyUsageOID.SERVER_AUTH
    CLIENT = ExtendedKeyUsageOID.CLIENT_AUTH
    # Of our own, from a UUID (X.667): it means something to this project alone.
    PERMIT = ObjectIdentifier("2.25.141825206059608487221651325911049793646")


@dataclass(frozen=True, slots=True)
class Identity:
    """A private key and its certificate, each in PEM."""

    key_pem: bytes
    certificate_pem: bytes

    def __repr__(self) -> str:
        return f"Identity({CertificateFacts.of(self.certificate_pem).common_name!r}, key not shown)"


@dataclass(frozen=True, slots=True)
class CertificateFacts:
    """What a certificate says of itself.

    Attributes
    ----------
    host_names
        Names and addresses under which a server may be reached.
    fingerprint
        SHA-256 of the certificate, in hexadecimal.
    """

    common_name: str
    not_before: datetime
    not_after: datetime
    host_names: tuple[str, ...]
    fingerprint: str

    @classmethod
    def of(cls, certificate_pem: bytes) -> Self:
        """Read a certificate; raises `ConfigurationError` when it is none."""
        certificate = _certificate(certificate_pem)
        names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        return cls(
            str(names[0].value) if names else "",
            certificate.not_valid_before_utc,
            certificate.not_valid_after_utc,
            _host_names(certificate),
            certificate.fingerprint(hashes.SHA256()).hex(),
        )


def new_authority(now: datetime) -> Identity:
    """Make an authority: a key, and a certificate that it signs itself."""
    key = ec.generate_private_key(ec.SECP256R1())
    usage = _key_usage(signs_certificates=True)
    # Two authorities of one name would make the errors of a rotation hard to read.
    name = _name(f"{AUTHORITY_NAME} {x509.random_serial_number() % 2**32:08x}")
    builder = (
        _builder(name, name, key.public_key(), now, now + AUTHORITY_VALID)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
    )
    return _signed(builder, key, key)


def issue(authority: Identity, common_name: str, use: Use, host_names: Sequence[str], now: datetime) -> Identity:
    """Make a key and have the authority sign its certificate.

    Parameters
    ----------
    common_name
        Whose it is: access control goes by this name.
    host_names
        Under which names and addresses a server may be reached; none for a client.

    Raises
    ------
    ConfigurationError
        When the authority's key or certificate cannot be read.
    """
    issuer_key, issuer = _private_key(authority.key_pem), _certificate(authority.certificate_pem)
    if not isinstance(issuer_key, ec.EllipticCurvePrivateKey):
        raise ConfigurationError("this is not the private key of an elliptic curve")
    key = ed25519.Ed25519PrivateKey.generate() if use is Use.PERMIT else ec.generate_private_key(ec.SECP256R1())
    not_after = min(now + CERTIFICATE_VALID, issuer.not_valid_after_utc)
    builder = (
        _builder(_name(common_name), issuer.subject, key.public_key(), now, not_after)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([use.value]), critical=True)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False)
    )
    if host_names:
        names = x509.SubjectAlternativeName([_general_name(name) for name in host_names])
        builder = builder.add_extension(names, critical=False)
    return _signed(builder, key, issuer_key)


def is_issued_by(authority_pem: bytes, certificate_pem: bytes) -> bool:
    """Whether the authority has signed a certificate."""
    try:
        _certificate(certificate_pem).verify_directly_issued_by(_certificate(authority_pem))
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def belong_together(identity: Identity) -> bool:
    """Whether the certificate is that of the key; they are not after a crash between the writing of the two."""
    return _private_key(identity.key_pem).public_key() == _certificate(identity.certificate_pem).public_key()


def is_for(certificate_pem: bytes, use: Use) -> bool:
    """Whether a certificate states this use, and no other."""
    try:
        stated = _certificate(certificate_pem).extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    except x509.ExtensionNotFound:
        return False
    return list(stated) == [use.value]


def _signed(builder: x509.CertificateBuilder, key: PrivateKey, by: ec.EllipticCurvePrivateKey) -> Identity:
    key_pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return Identity(key_pem, builder.sign(by, hashes.SHA256()).public_bytes(serialization.Encoding.PEM))


def _builder(
    subject: x509.Name, issuer: x509.Name, key: PublicKey, now: datetime, not_after: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _VALID_BEFORE_NOW)
        .not_valid_after(not_after)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general_name(host_name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host_name))
    except ValueError:
        return x509.DNSName(host_name)


def _host_names(certificate: x509.Certificate) -> tuple[str, ...]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(name.value) for name in names)


def _certificate(pem: bytes) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(pem)
    except ValueError:
        raise ConfigurationError("this is not a certificate in PEM") from None


def _private_key(pem: bytes) -> PrivateKey:
    try:
        key = serialization.load_pem_private_key(pem, password=None)
    except (ValueError, TypeError):
        raise ConfigurationError("this is not an unencrypted private key in PEM") from None
    if not isinstance(key, PrivateKey):
        raise ConfigurationError("this is not the private key of an elliptic curve")
    return key
