"""What the authority issues, read back by the library that made it; that Zenoh takes it is tested with a router."""

from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from shared.errors import ConfigurationError
from shared.pki.authority import (
    AUTHORITY_VALID,
    CERTIFICATE_VALID,
    CertificateFacts,
    Identity,
    Use,
    belong_together,
    is_issued_by,
    issue,
    new_authority,
)

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)
AUTHORITY = new_authority(NOW)
ROBOT = issue(AUTHORITY, "robot", Use.CLIENT, (), NOW)
ROUTER = issue(AUTHORITY, "router", Use.SERVER, ("localhost", "127.0.0.1"), NOW)


def certificate(identity: Identity) -> x509.Certificate:
    return x509.load_pem_x509_certificate(identity.certificate_pem)


def purposes(identity: Identity) -> list[x509.ObjectIdentifier]:
    return list(certificate(identity).extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)


def test_a_service_can_only_call_and_the_router_can_only_answer() -> None:
    assert purposes(ROBOT) == [ExtendedKeyUsageOID.CLIENT_AUTH]
    assert purposes(ROUTER) == [ExtendedKeyUsageOID.SERVER_AUTH]


def test_keys_lie_on_p_256_and_no_two_are_the_same() -> None:
    keys = [certificate(identity).public_key() for identity in (AUTHORITY, ROBOT, ROUTER)]
    assert [key.curve.name for key in keys if isinstance(key, ec.EllipticCurvePublicKey)] == ["secp256r1"] * 3
    assert len({key.public_numbers() for key in keys if isinstance(key, ec.EllipticCurvePublicKey)}) == 3


def test_only_the_authority_may_sign_and_only_ends() -> None:
    limits = [
        certificate(identity).extensions.get_extension_for_class(x509.BasicConstraints).value
        for identity in (AUTHORITY, ROBOT, ROUTER)
    ]
    assert [(limit.ca, limit.path_length) for limit in limits] == [(True, 0), (False, None), (False, None)]


def test_facts_name_owner_hosts_and_dates() -> None:
    facts = CertificateFacts.of(ROUTER.certificate_pem)
    assert (facts.common_name, facts.host_names) == ("router", ("localhost", "127.0.0.1"))
    assert facts.not_after == NOW + CERTIFICATE_VALID
    assert facts.not_before < NOW
    assert facts.fingerprint != CertificateFacts.of(ROBOT.certificate_pem).fingerprint


def test_no_certificate_outlives_its_authority() -> None:
    late = NOW + AUTHORITY_VALID - timedelta(days=10)
    end = CertificateFacts.of(AUTHORITY.certificate_pem).not_after
    assert CertificateFacts.of(issue(AUTHORITY, "robot", Use.CLIENT, (), late).certificate_pem).not_after == end


def test_another_authority_of_the_same_project_has_issued_nothing() -> None:
    other = new_authority(NOW)
    assert is_issued_by(AUTHORITY.certificate_pem, ROBOT.certificate_pem)
    assert not is_issued_by(other.certificate_pem, ROBOT.certificate_pem)
    assert not is_issued_by(ROBOT.certificate_pem, ROBOT.certificate_pem)


def test_a_name_alone_does_not_make_an_authority() -> None:
    """A second key that carries the authority's own name must not pass for it."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = certificate(AUTHORITY).subject
    forged = (
        x509.CertificateBuilder()
        .subject_name(certificate(ROBOT).subject)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(NOW)
        .not_valid_after(NOW + timedelta(days=1))
        .sign(key, hashes.SHA256())
    )
    assert not is_issued_by(AUTHORITY.certificate_pem, forged.public_bytes(Encoding.PEM))


def test_key_and_certificate_of_different_makings_do_not_belong_together() -> None:
    assert belong_together(ROBOT)
    assert not belong_together(Identity(ROUTER.key_pem, ROBOT.certificate_pem))


def test_a_key_is_never_shown() -> None:
    assert repr(ROBOT) == "Identity('robot', key not shown)"


@pytest.mark.parametrize(
    ("authority", "sentence"),
    [
        (Identity(AUTHORITY.key_pem, b"no"), "this is not a certificate in PEM"),
        (Identity(b"no", AUTHORITY.certificate_pem), "this is not an unencrypted private key in PEM"),
    ],
)
def test_what_is_no_key_and_no_certificate_is_refused(authority: Identity, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        issue(authority, "robot", Use.CLIENT, (), NOW)


def test_a_key_of_another_kind_is_refused() -> None:
    pem = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    with pytest.raises(ConfigurationError, match="this is not the private key of an elliptic curve"):
        issue(Identity(pem, AUTHORITY.certificate_pem), "robot", Use.CLIENT, (), NOW)
