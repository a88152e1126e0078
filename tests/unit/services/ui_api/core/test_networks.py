"""Which addresses are in the room."""

import ipaddress

import pytest

from services.ui_api.core.networks import PRIVATE_NETWORKS, is_in_networks


@pytest.mark.parametrize(
    ("address", "inside"),
    [
        ("127.0.0.1", True),
        ("10.1.2.3", True),
        ("172.31.0.1", True),
        ("172.32.0.1", False),
        ("::ffff:192.168.1.2", True),
        ("::ffff:8.8.8.8", False),
        ("fe80::1%eth0", True),
        ("2001:db8::1", False),
        ("8.8.8.8", False),
        ("unknown", False),
    ],
)
def test_loopback_private_and_link_local_addresses_are_in_the_room(address: str, *, inside: bool) -> None:
    assert is_in_networks(address, PRIVATE_NETWORKS) is inside


def test_a_setting_replaces_them() -> None:
    assert not is_in_networks("127.0.0.1", (ipaddress.ip_network("192.0.2.0/24"),))
