"""Ports of this machine: which are free, which are taken, which answer."""

import random
import socket
from pathlib import Path

from shared.errors import ConfigurationError

_LOOPBACK = "127.0.0.1"
_LEAST_PORT = 20_000  # below are those of well-known services
_EPHEMERAL_PORTS = Path("/proc/sys/net/ipv4/ip_local_port_range")
_LEAST_TO_CHOOSE_FROM = 1_000


def tcp_port_answers(port: int, host: str = _LOOPBACK) -> bool:
    """Whether something accepts connections on a local port."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((host, port)) == 0


def require_free_port(port: int, used_for: str, option: str) -> None:
    """Refuse a port that is taken, before anything is started.

    Raises
    ------
    ConfigurationError
        Naming the port, its purpose and the option that chooses another.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_LOOPBACK, port))
        except OSError as error:
            raise ConfigurationError(
                f"port {port} for {used_for} is in use ({error.strerror}); end the program that holds it "
                f"or choose another with {option}"
            ) from None


def free_ports(count: int) -> list[int]:
    """Ports that are free now for TCP and UDP, all different.

    They lie below those that the system gives to outgoing connections: of these, any may be taken between this call and
    the start of the program that listens.
    """
    least, beyond = _LEAST_PORT, _least_ephemeral_port()
    if beyond - least < _LEAST_TO_CHOOSE_FROM:
        least, beyond = 1_024, 65_536
    found: list[int] = []
    for port in random.sample(range(least, beyond), beyond - least):
        if len(found) == count:
            break
        if _is_free(port):
            found.append(port)
    if len(found) < count:
        raise ConfigurationError(f"only {len(found)} of {count} ports are free on this machine; end what holds them")
    return found


def _least_ephemeral_port() -> int:
    try:
        return int(_EPHEMERAL_PORTS.read_text().split()[0])
    except OSError:
        return 32_768  # Linux's own default; other systems begin higher


def _is_free(port: int) -> bool:
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind((_LOOPBACK, port))
            except OSError:
                return False
    return True
