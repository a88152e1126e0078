"""DICOM under TLS: who may connect, with which certificate and which protocol."""

import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
import structlog
import structlog.testing
from pydicom.uid import ExplicitVRLittleEndian, SecondaryCaptureImageStorage
from pynetdicom import AE

from services.imaging.devices.dicom_receiver import Endpoint, dicom_receiver
from shared.bus.tls import TlsFiles
from shared.pki.keystore import Keystore
from shared.pki.network import C_ARM, DICOM, REST, network_keystore
from shared.runtime.tls_context import Clients, server_context
from tests.unit.services.imaging.devices.dicom_samples import dataset_of, grey_ramp

PATIENCE_S = 10.0
LOG: structlog.stdlib.BoundLogger = structlog.stdlib.get_logger("test")


@pytest.fixture(scope="module")
def keystore(tmp_path_factory: pytest.TempPathFactory) -> Keystore:
    made = network_keystore(tmp_path_factory.mktemp("pki"))
    made.ensure(datetime.now(UTC))
    return made


def files(keystore: Keystore, name: str) -> TlsFiles:
    return TlsFiles.in_folder(keystore.folder_of(name))


@contextmanager
def receiving(keystore: Keystore, *senders: str) -> Iterator[tuple[int, list[str]]]:
    tls = server_context(files(keystore, DICOM), Clients.WITH_CERTIFICATE)
    taken: list[str] = []
    endpoint = Endpoint("127.0.0.1", 0, "DISTALOCK", tls=tls, tls_senders=senders)
    with dicom_receiver(endpoint, lambda _content, sender, *_: taken.append(sender), LOG) as port:
        yield port, taken


def client_context(keystore: Keystore, name: str | None) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=str(files(keystore, C_ARM).authority))
    if name is not None:
        context.load_cert_chain(files(keystore, name).certificate, files(keystore, name).key)
    return context


def sent(port: int, context: ssl.SSLContext) -> bool:
    """Whether an image is taken."""
    entity = AE(ae_title="CARM")
    entity.acse_timeout = entity.network_timeout = entity.connection_timeout = PATIENCE_S
    entity.add_requested_context(SecondaryCaptureImageStorage, ExplicitVRLittleEndian)
    association = entity.associate("127.0.0.1", port, ae_title="DISTALOCK", tls_args=(context, "localhost"))
    assert association.is_established
    status = association.send_c_store(dataset_of(grey_ramp()))
    association.release()
    return bool(status.get("Status") == 0)


def is_hung_up_on(port: int, context: ssl.SSLContext | None) -> bool:
    """Whether a connection is closed before it gets an answer to the beginning of a request."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as link:
        try:
            if context is not None:
                with context.wrap_socket(link, server_hostname="localhost") as secured:
                    secured.sendall(b"\x01\x00")
                    return secured.recv(1) == b""
            link.sendall(b"\x01\x00")
            return link.recv(1)[:1] in (b"", b"\x15")  # the end, or an alert of TLS
        except OSError:
            return True


def test_a_c_arm_with_its_certificate_is_taken(keystore: Keystore) -> None:
    with receiving(keystore, C_ARM) as (port, taken):
        assert sent(port, client_context(keystore, C_ARM))
    assert taken == ["CARM@127.0.0.1"]


def test_without_tls_or_certificate_nobody_is_taken(keystore: Keystore) -> None:
    with receiving(keystore) as (port, taken), structlog.testing.capture_logs() as logged:
        assert is_hung_up_on(port, None)
        assert is_hung_up_on(port, client_context(keystore, None))
    assert taken == []
    assert any("no link under TLS" in str(line.get("detail")) for line in logged)


def test_a_certificate_of_another_authority_counts_for_nothing(keystore: Keystore, tmp_path: Path) -> None:
    other = network_keystore(tmp_path)
    other.ensure(datetime.now(UTC))
    context = client_context(keystore, None)
    context.load_cert_chain(files(other, C_ARM).certificate, files(other, C_ARM).key)
    with receiving(keystore) as (port, taken):
        assert is_hung_up_on(port, context)
    assert taken == []


def test_a_server_s_certificate_is_no_sender_s(keystore: Keystore) -> None:
    with receiving(keystore) as (port, taken):
        assert is_hung_up_on(port, client_context(keystore, REST))
    assert taken == []


def test_who_is_not_named_is_rejected(keystore: Keystore) -> None:
    with receiving(keystore, "other_c_arm") as (port, taken), structlog.testing.capture_logs() as logged:
        assert is_hung_up_on(port, client_context(keystore, C_ARM))
    assert taken == []
    assert any("dicom_tls_senders allows other_c_arm" in str(line.get("detail")) for line in logged)


def test_old_protocols_and_suites_are_not_spoken(keystore: Keystore) -> None:
    context = server_context(files(keystore, DICOM), Clients.WITH_CERTIFICATE)
    assert context.minimum_version is ssl.TLSVersion.TLSv1_2
    for suite in context.get_ciphers():
        assert suite["protocol"] == "TLSv1.3" or "ECDHE" in suite["name"]
        assert suite["aead"]
