"""HTTPS: when it is needed, and what it speaks."""

import ssl
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest

from services.ui_api.settings import UiApiSettings
from shared.bus.keys import Keys
from shared.bus.tls import PKI_FOLDER
from shared.errors import ConfigurationError
from shared.pki.network import network_keystore
from shared.runtime.tls_context import Clients, server_context
from tests.unit.services.ui_api.room import ROOM, Room
from tests.unit.services.ui_api.served import served


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.8.0.1"])
def test_the_loopback_interface_needs_none(tmp_path: Path, host: str) -> None:
    assert UiApiSettings(state_dir=tmp_path, host=host).https_files() is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "or1.hospital"])
def test_every_other_address_needs_it_or_a_word(tmp_path: Path, host: str) -> None:
    with pytest.raises(
        ConfigurationError, match=f"would listen on {host} without TLS.*set DISTALOCK_UI_API_HTTPS=true"
    ):
        UiApiSettings(state_dir=tmp_path, host=host).https_files()
    assert UiApiSettings(state_dir=tmp_path, host=host, plain_http=True).https_files() is None
    assert UiApiSettings(state_dir=tmp_path, host=host, https=True).https_files() is not None


def test_missing_files_are_named(tmp_path: Path) -> None:
    files = UiApiSettings(state_dir=tmp_path, https=True).https_files()
    assert files is not None
    with pytest.raises(ConfigurationError, match=r"network/rest/certificate.pem is missing.*distalock pki init"):
        server_context(files, Clients.ANYBODY)


def test_the_gateway_speaks_https_to_who_trusts_the_authority(quiet_room: Room, tmp_path: Path) -> None:
    network_keystore(tmp_path / PKI_FOLDER).ensure(datetime.now(UTC))
    files = UiApiSettings(state_dir=tmp_path, https=True).https_files()
    assert files is not None
    context = server_context(files, Clients.ANYBODY)
    with served(quiet_room.gateway, quiet_room.router, Keys(ROOM), context) as address:
        url = f"{address}/healthz"
        trusting = ssl.create_default_context(cafile=str(files.authority))
        answer = httpx.get(url, verify=trusting)
        assert answer.json()["status"] == "ok"
        assert answer.headers["strict-transport-security"].startswith("max-age=")
        with pytest.raises(httpx.ConnectError, match="certificate verify failed"):
            httpx.get(url)
        trusting.maximum_version = ssl.TLSVersion.TLSv1_2
        trusting.set_ciphers("ECDHE-ECDSA-AES128-SHA256")
        with pytest.raises(httpx.ConnectError):
            httpx.get(url, verify=trusting)
        with pytest.raises(httpx.HTTPError):
            httpx.get(url.replace("https", "http"))
