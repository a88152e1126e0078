"""Who sees which key in containers: each service its own, and the authority's nobody but who issues."""

import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest

from shared.bus.shared_memory import LOCKED_BYTES
from shared.messages.presence import ServiceName
from shared.pki.keystore import NAMES
from shared.pki.network import NETWORK
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PERMIT_KEY_FILE

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / "docker-compose.yml").read_text()

# What faces the hospital's network, and the key for it.
SERVERS = {
    "ui_api": [("keys-rest", "/run/distalock/https:ro")],
    "imaging": [("keys-dicom", "/run/distalock/dicom:ro")],
}


def block_of(service: str) -> str:
    """Lines of one service."""
    services = TEXT.split("\nservices:\n")[1].split("\nvolumes:\n")[0]
    (block,) = re.findall(rf"(?ms)^  {service}:\n(.*?)(?=^  \S|\Z)", services)
    return str(block)


def volume_of(name: str) -> str:
    return f"keys-{name.replace('_', '-')}"


@pytest.mark.parametrize("service", NAMES)
def test_a_container_sees_its_own_keys_and_no_other(service: str) -> None:
    mounted = re.findall(r"- (keys-[a-z-]+):(\S+)", block_of(service))
    assert mounted == [(volume_of(service), "/run/distalock/tls:ro"), *SERVERS.get(service, ())]


def test_only_who_issues_sees_all_of_them_and_it_has_no_network() -> None:
    mounted = dict(re.findall(r"- (keys-[a-z-]+):(\S+)", block_of("pki")))
    of_the_bus = {volume_of(name): f"/keys/pki/{name}" for name in ("authority", *NAMES)}
    of_the_network = {volume_of(name): f"/keys/pki/network/{name}" for name in NETWORK}
    assert mounted == of_the_bus | of_the_network | {"keys-network": "/keys/pki/network/authority"}
    assert "network_mode: none" in block_of("pki")


def test_the_gateway_finds_the_key_of_permits_in_its_volume_and_the_robot_its_certificate() -> None:
    assert f"DISTALOCK_UI_API_PERMIT_KEY: /run/distalock/tls/{PERMIT_KEY_FILE}\n" in block_of("ui_api")
    certificate = f"DISTALOCK_ROBOT_PERMIT_CERTIFICATE: /run/distalock/tls/{PERMIT_CERTIFICATE_FILE}\n"
    assert certificate in block_of("robot")


@pytest.mark.parametrize("extra", ["robot", "ui-api"])
def test_containers_that_sign_or_verify_have_the_library(extra: str) -> None:
    optional = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert any(requirement.startswith("cryptography") for requirement in optional[extra])


def test_the_bus_is_under_tls() -> None:
    assert "DISTALOCK_ROUTER_ENDPOINT: tls/router:7447" in TEXT
    assert "tls/0.0.0.0:7447" in block_of("router")
    assert "plain-bus" not in TEXT
    assert "tcp/" not in TEXT


def test_what_others_reach_is_under_tls() -> None:
    gateway = block_of("ui_api")
    assert "DISTALOCK_UI_API_HTTPS: ${DISTALOCK_HTTPS:-true}" in gateway
    assert "DISTALOCK_UI_API_PLAIN_HTTP: ${DISTALOCK_PLAIN_HTTP:-false}" in gateway


def test_containers_may_lock_the_pool_of_frames() -> None:
    (limit,) = re.findall(r"memlock: (\d+)", TEXT)
    assert int(limit) >= LOCKED_BYTES
    for service in get_args(ServiceName):
        assert "<<: *service" in block_of(service)
        assert "/dev/shm:/dev/shm" in block_of(service)


def test_each_volume_of_keys_is_mounted_where_the_image_has_a_folder_of_its_user() -> None:
    """A volume takes the owner of the folder that it is first mounted on; root's cannot be written."""
    made = set(
        re.findall(r"/keys\S*", (ROOT / "deploy/pki/Dockerfile").read_text().split("mkdir -p")[1].split("&&")[0])
    )
    mounted = set(re.findall(r"- keys-[a-z-]+:(\S+)", block_of("pki")))
    assert mounted
    assert mounted <= made


def test_the_record_is_the_gateways_alone_and_images_are_shared_with_imaging() -> None:
    mounted = {
        service: re.findall(r"- ([a-z-]+):(/var/lib/\S+)", block_of(service)) for service in get_args(ServiceName)
    }
    images = ("images", "/var/lib/distalock/images")
    assert mounted == {
        "imaging": [("state-imaging", "/var/lib/distalock"), images],
        "registration": [],
        "robot": [],
        "ui_api": [("state", "/var/lib/distalock"), images],
    }


@pytest.mark.parametrize("service", ["imaging", "ui_api"])
def test_who_mounts_images_has_a_folder_of_its_user_for_them(service: str) -> None:
    text = (ROOT / "services" / service / "Dockerfile").read_text()
    assert "mkdir -p /var/lib/distalock/images && chown -R distalock /var/lib/distalock" in text
