"""Where an installation listens, and what it keeps for itself."""

from pathlib import Path

import pytest

from distalock.installation import Installation, Ports
from distalock.readiness import Server
from services.robot.settings import RobotSettings
from services.ui_api.settings import UiApiSettings

PORTS = Ports(1, 2, 3, 4, 5)


@pytest.mark.parametrize("plain_bus", [False, True])
def test_permits_are_signed_with_and_without_tls(tmp_path: Path, *, plain_bus: bool) -> None:
    Installation(Ports(1, 2, 3, 4, 5), tmp_path, "/dev/ttyUSB0", plain_bus=plain_bus).make_keys()
    signer = UiApiSettings(state_dir=tmp_path).permit_signer()
    verifier = RobotSettings(state_dir=tmp_path).permit_verifier()
    assert signer.key_sha256 == verifier.key_sha256


def test_ports_and_a_real_controller_are_reserved(tmp_path_factory: pytest.TempPathFactory) -> None:
    installation = Installation(Ports(1, 2, 3, 4, 5), tmp_path_factory.mktemp("state"), "/dev/ttyUSB0")
    assert installation._reservations() == {
        "port 1": "end it, or choose another with --router-port",
        "port 2": "end it, or choose another with --rest-port",
        "port 3": "end it, or choose another with --dicom-port",
        "the hexapod controller at /dev/ttyUSB0": "end it, or choose another with --controller",
    }


@pytest.fixture
def nowhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISTALOCK_UI_API_HOST", "DISTALOCK_UI_API_HTTPS_CERTIFICATE"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("nowhere_else")
def test_the_gateway_is_on_the_loopback_interface_without_tls() -> None:
    assert Installation(PORTS, Path("s")).gateway == Server("http://127.0.0.1:2")


@pytest.mark.usefixtures("nowhere_else")
def test_https_has_the_certificate_of_the_network_s_authority() -> None:
    authority = Path("s/pki/network/rest/authority.pem")
    assert Installation(PORTS, Path("s"), https=True).gateway == Server("https://127.0.0.1:2", authority)


@pytest.mark.parametrize(
    ("host", "url"),
    [("0.0.0.0", "http://127.0.0.1:2"), ("10.1.2.3", "http://10.1.2.3:2"), ("::1", "http://[::1]:2")],
)
def test_the_gateway_is_called_where_it_listens(monkeypatch: pytest.MonkeyPatch, host: str, url: str) -> None:
    monkeypatch.setenv("DISTALOCK_UI_API_HOST", host)
    assert Installation(PORTS, Path("s")).gateway.url == url
