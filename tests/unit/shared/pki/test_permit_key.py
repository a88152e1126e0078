"""Who can sign permits to move, and what the robot takes for the gateway's signature."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from shared.bus.tls import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE
from shared.errors import ConfigurationError
from shared.messages.permits import Permit, SignedPermit
from shared.pki.authority import CERTIFICATE_VALID
from shared.pki.keystore import PERMIT, Keystore
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PERMIT_KEY_FILE, PermitSigner, PermitVerifier

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)
PERMIT_TO_MOVE = Permit(
    motion="move",
    plan_sha256="a" * 64,
    hole_ids=("distal",),
    case_id="case1",
    case_revision=2,
    robot_boot_epoch="boot",
    after_state_sequence=7,
    approver="Dr A",
    nothing_inside=True,
    nonce="n1",
)


class Pair:
    """The gateway's and the robot's files of one installation."""

    def __init__(self, folder: Path) -> None:
        self.keystore = Keystore(folder)
        self.keystore.ensure(NOW)
        self.key = self.keystore.folder_of("ui_api") / PERMIT_KEY_FILE
        self.certificate = self.keystore.folder_of("robot") / PERMIT_CERTIFICATE_FILE
        self.authority = self.keystore.folder_of("robot") / AUTHORITY_FILE

    def signer(self) -> PermitSigner:
        return PermitSigner.from_file(self.key)

    def verifier(self, now: datetime = NOW) -> PermitVerifier:
        return PermitVerifier.from_files(self.certificate, self.authority, now)


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    return Pair(tmp_path / "pki")


def test_what_the_gateway_signs_the_robot_knows(pair: Pair) -> None:
    signed = pair.signer().sign(PERMIT_TO_MOVE)
    assert pair.verifier().has_signed(signed)
    assert signed.key_sha256 == pair.verifier().key_sha256
    assert '"approver":"Dr A"' in signed.permit_json


@pytest.mark.parametrize(
    ("old", "new"), [("Dr A", "Dr B"), ("distal", "proximal"), ('"nothing_inside":true', '"nothing_inside":false')]
)
def test_no_word_can_be_changed_afterwards(pair: Pair, old: str, new: str) -> None:
    signed = pair.signer().sign(PERMIT_TO_MOVE)
    altered = signed.model_copy(update={"permit_json": signed.permit_json.replace(old, new)})
    assert altered != signed
    assert not pair.verifier().has_signed(altered)


def test_a_key_of_another_installation_or_of_before_signs_nothing_here(pair: Pair, tmp_path: Path) -> None:
    def verdict(signer: PermitSigner) -> bool:
        signed: SignedPermit = signer.sign(PERMIT_TO_MOVE)
        return pair.verifier().has_signed(signed)

    lost = pair.signer()
    assert not verdict(Pair(tmp_path / "other").signer())
    pair.keystore.issue((PERMIT,), NOW)
    assert not verdict(lost)
    assert verdict(pair.signer())


def test_a_certificate_of_another_authority_is_refused(pair: Pair, tmp_path: Path) -> None:
    pair.certificate.write_bytes(Pair(tmp_path / "other").certificate.read_bytes())
    with pytest.raises(ConfigurationError, match=r"is not signed by the authority in .*; make it"):
        pair.verifier()


def test_the_certificate_of_a_service_is_none_for_permits(pair: Pair) -> None:
    pair.certificate.write_bytes((pair.keystore.folder_of("ui_api") / CERTIFICATE_FILE).read_bytes())
    with pytest.raises(ConfigurationError, match="is not a certificate for permits to move"):
        pair.verifier()


@pytest.mark.parametrize("later", [CERTIFICATE_VALID + timedelta(days=1), -timedelta(days=1)])
def test_a_certificate_that_is_not_valid_now_is_refused(pair: Pair, later: timedelta) -> None:
    with pytest.raises(ConfigurationError, match="is valid from 2026-03-01 to 2027-03-01, and today is"):
        pair.verifier(NOW + later)


def test_what_is_missing_is_named(pair: Pair) -> None:
    pair.key.unlink()
    pair.certificate.unlink()
    with pytest.raises(ConfigurationError, match=r"permit_key\.pem is missing: without it no permit to move"):
        pair.signer()
    with pytest.raises(ConfigurationError, match=r"permit_certificate\.pem is missing: without it no permit to move"):
        pair.verifier()


def test_a_signing_key_that_others_can_read_is_refused(pair: Pair) -> None:
    pair.key.chmod(0o640)
    with pytest.raises(ConfigurationError, match=r"permit_key.pem can be read by others \(mode 0640"):
        pair.signer()


def test_the_key_of_a_service_signs_no_permits(pair: Pair) -> None:
    pair.key.write_bytes((pair.keystore.folder_of("ui_api") / KEY_FILE).read_bytes())
    with pytest.raises(ConfigurationError, match="is not an Ed25519 key"):
        pair.signer()
    pair.key.write_text("nothing")
    with pytest.raises(ConfigurationError, match="is not an unencrypted private key in PEM"):
        pair.signer()
