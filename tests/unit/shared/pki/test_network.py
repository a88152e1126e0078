"""What faces the hospital's network has an authority of its own."""

from datetime import UTC, datetime
from pathlib import Path

from shared.bus.tls import NETWORK_FOLDER, TlsFiles
from shared.pki.authority import Use, is_for, is_issued_by
from shared.pki.keystore import Keystore
from shared.pki.network import C_ARM, DICOM, NETWORK, REST, network_keystore

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)


def test_neither_authority_believes_what_the_other_signed(tmp_path: Path) -> None:
    bus, network = Keystore(tmp_path), network_keystore(tmp_path)
    bus.ensure(NOW)
    assert network.ensure(NOW) == tuple(NETWORK)
    for store, other in ((bus, network), (network, bus)):
        authority = (other.folder / "authority" / "authority.pem").read_bytes()
        for name in store.holders:
            if name != "permit":
                assert not is_issued_by(authority, TlsFiles.in_folder(store.folder_of(name)).certificate.read_bytes())


def test_servers_and_the_c_arm_have_certificates_for_what_they_do(tmp_path: Path) -> None:
    network = network_keystore(tmp_path / "pki")
    network.ensure(NOW, ["or1.hospital"])
    for name, use in ((REST, Use.SERVER), (DICOM, Use.SERVER), (C_ARM, Use.CLIENT)):
        files = TlsFiles.in_network(tmp_path, name)
        files.require()
        assert files.certificate.parent.parent.name == NETWORK_FOLDER
        assert is_for(files.certificate.read_bytes(), use)
    stated = {entry.name: entry.facts.host_names for entry in network.entries(NOW) if entry.facts}
    assert stated[REST] == ("localhost", "127.0.0.1", "::1", "ui_api", "or1.hospital")
    assert stated[C_ARM] == ()


def test_a_further_name_makes_the_servers_certificates_anew(tmp_path: Path) -> None:
    network = network_keystore(tmp_path)
    network.ensure(NOW)
    assert network.ensure(NOW, ["or1.hospital"]) == (REST, DICOM)
    assert network.ensure(NOW, ["or1.hospital"]) == ()
