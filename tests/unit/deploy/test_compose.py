"""Who sees which key in containers: each service its own, and the authority's nobody but who issues."""

import re
import tomllib
from itertools import takewhile
from pathlib import Path
from typing import get_args

import pytest

from shared.bus.access import EXPORTER
from shared.bus.shared_memory import LOCKED_BYTES, MOST_POOL_BYTES
from shared.messages.presence import ServiceName
from shared.pki.keystore import NAMES
from shared.pki.network import NETWORK
from shared.pki.permit_key import PERMIT_CERTIFICATE_FILE, PERMIT_KEY_FILE

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / "docker-compose.yml").read_text()
DOCKERFILE = (ROOT / "deploy/Dockerfile").read_text()
# Folders of the base layer, which belong to the services' user.
FOLDERS = set(re.findall(r"/\S+", DOCKERFILE.split("mkdir -p")[1].split("&&")[0]))
BUILT = ("router", *get_args(ServiceName), "virtual-or", "pki")

# What faces the hospital's network, and the key for it.
SERVERS = {
    "ui_api": [("keys-rest", "/run/distalock/https:ro")],
    "imaging": [("keys-dicom", "/run/distalock/dicom:ro")],
    "exporter": [("keys-site", "/run/distalock/site:ro")],
}


def block_of(service: str) -> str:
    """Lines of one service."""
    services = TEXT.split("\nservices:\n")[1].split("\nnetworks:\n")[0]
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
    assert mounted == of_the_bus | of_the_network | {
        "keys-network": "/keys/pki/network/authority",
        "keys-logs": "/keys/logs",
        "keys-site": "/keys/site",
    }
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


def test_containers_may_lock_the_pool_of_frames_and_share_its_memory() -> None:
    (limit,) = re.findall(r"memlock: \$\{DISTALOCK_MEMLOCK:-(\d+)\}", TEXT)
    assert int(limit) >= LOCKED_BYTES
    for service in (name for name in NAMES if name != EXPORTER):  # which receives no frames
        assert "<<: *service" in block_of(service)
        assert "frames:/dev/shm:nocopy" in block_of(service)  # a copy would take the mode of the image's folder
    (size_mib,) = re.findall(r"size=(\d+)m,mode=1777,nosuid", TEXT)
    sessions = len(NAMES)  # the gateway has two, the exporter none
    assert int(size_mib) * 2**20 >= (sessions + 1) * MOST_POOL_BYTES


def test_each_volume_is_mounted_where_the_image_has_a_folder_of_its_user() -> None:
    """A volume takes the owner of the folder that it is first mounted on; root's cannot be written."""
    mounted = set(re.findall(r"- (?:keys-[a-z-]+|state[a-z-]*|images|guardian|demo):(/[^:\s]+)", TEXT))
    made = {str(parent) for folder in FOLDERS for parent in (Path(folder), *Path(folder).parents)}
    assert {"/keys/pki/authority", "/run/distalock/guardian", "/var/lib/distalock/images"} <= mounted
    assert mounted - {"/run/distalock/https", "/run/distalock/dicom"} <= made  # those are only read


def test_the_record_is_the_gateways_alone_and_images_are_shared_with_imaging() -> None:
    mounted = {service: re.findall(r"- ([a-z-]+):(/var/lib/\S+)", block_of(service)) for service in BUILT}
    images = ("images", "/var/lib/distalock/images")
    alone = {f"{name}": [(f"state-{name}", "/var/lib/distalock")] for name in ("registration", "robot")}
    assert mounted == alone | {
        "router": [],
        "virtual-or": [],
        "pki": [],
        "imaging": [("state-imaging", "/var/lib/distalock"), images],
        "ui_api": [("state", "/var/lib/distalock"), images],
    }


SERVICES = re.findall(r"(?m)^  ([a-z_-]+):$", TEXT.split("\nservices:\n")[1].split("\nnetworks:\n")[0])


@pytest.mark.parametrize("service", SERVICES)
def test_no_container_has_more_rights_than_it_needs(service: str) -> None:
    assert re.search(r"<<: \*(contained|service)$", block_of(service), re.MULTILINE)
    contained = "".join(takewhile(str.strip, TEXT.split("x-contained:")[1].splitlines(keepends=True)))
    for line in ("read_only: true", 'cap_drop: ["ALL"]', 'security_opt: ["no-new-privileges:true"]', "max-size"):
        assert line in contained
    assert "privileged: true" not in block_of(service)
    assert "mem_limit" in block_of(service)


@pytest.mark.parametrize("service", [name for name in SERVICES if name not in ("pki", "demo-user", "virtual-or")])
def test_what_runs_for_long_has_a_health_check_and_time_to_leave(service: str) -> None:
    block = block_of(service)
    assert "healthcheck" in block or "<<: *service" in block
    assert "stop_grace_period" in block or "<<: *service" in block


def test_a_router_that_comes_back_is_not_waited_for_by_its_name() -> None:
    """The usual resolver waits 5 s for an answer that never comes while the router's name is unknown."""
    (options,) = re.findall(r"dns_opt: \[(.*)\]", TEXT.split("x-service:")[1])
    assert '"timeout:1"' in options


def test_the_bus_is_a_network_of_its_own_without_a_way_out() -> None:
    networks = {name: re.findall(r"networks: \[(.*)\]", block_of(name)) for name in SERVICES}
    assert {name for name, found in networks.items() if "hospital" in "".join(found)} == {
        "imaging",
        "ui_api",
        "exporter",
        "virtual-or",
        "archive",
    }
    assert "  bus:\n    internal: true\n" in TEXT


@pytest.mark.parametrize("service", ["imaging", "registration"])
def test_services_with_kernels_hold_their_library_and_no_compiler(service: str) -> None:
    assert "target: compute" in block_of(service)
    assert "WITHOUT: numba" in block_of(service)
    compute = DOCKERFILE.split("AS compute")[1].split("FROM")[0]
    assert "COPY --from=kernels /opt/kernels /opt/packages" in compute


def test_the_virtual_room_finds_its_kernels_compiled() -> None:
    assert "target: simulated" in block_of("virtual-or")
    simulated = DOCKERFILE.split("AS simulated")[1]
    # the same processor at build and at run: machine code for another one would be made anew at every start
    for line in ("ENV NUMBA_CPU_NAME=${KERNEL_CPU} NUMBA_CPU_FEATURES=", "ARG KERNEL_CPU=x86-64-v3"):
        assert DOCKERFILE.count(line) == 2
        assert line in simulated


def test_images_install_wheels_by_their_hashes_alone() -> None:
    installs = [line for line in DOCKERFILE.splitlines() if "pip install" in line]
    assert installs
    assert all("--only-binary :all: --require-hashes" in line for line in installs)


@pytest.mark.parametrize("name", ["clinic", "simulation"])
def test_only_a_simulation_has_the_user_demo_and_takes_any_part(name: str) -> None:
    content = (ROOT / f"deploy/environments/{name}.env").read_text()
    assert ("DISTALOCK_UI_API_DEMO_TOKEN_FILE=" in content) is (name == "simulation")
    assert ("DISTALOCK_UI_API_UNAPPROVED_PARTS=true" in content) is (name == "simulation")
    assert "${DISTALOCK_ENVIRONMENT:-clinic}.env" in block_of("ui_api")
