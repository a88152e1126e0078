"""What an address to listen on means."""

import ipaddress
from typing import Final

PLAIN_HTTP_WARNING: Final = (
    "REST is without TLS on an address that others reach: whoever is on the way can read patients' data and change "
    "requests"
)


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine reach an address; a name other than localhost may be anybody's."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
