"""Which ports of this machine are free, taken, or answer."""

import socket
from pathlib import Path

import pytest

from distalock.local_ports import free_ports, require_free_port, tcp_port_answers
from shared.errors import ConfigurationError

EPHEMERAL_PORTS = Path("/proc/sys/net/ipv4/ip_local_port_range")


def test_a_port_in_use_is_refused_with_the_option_that_helps() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        assert tcp_port_answers(port)
        with pytest.raises(ConfigurationError, match=rf"port {port} for REST is in use .*--rest-port"):
            require_free_port(port, "REST", "--rest-port")


def test_free_ports_differ_and_no_outgoing_connection_takes_one() -> None:
    ports = free_ports(5)
    assert len(set(ports)) == 5
    assert not any(tcp_port_answers(port) for port in ports)
    if EPHEMERAL_PORTS.exists():
        assert max(ports) < int(EPHEMERAL_PORTS.read_text().split()[0])


def test_a_port_in_use_is_not_among_the_free_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    taken, free = free_ports(2)
    monkeypatch.setattr("random.sample", lambda _ports, _count: [taken, free])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", taken))
        assert free_ports(1) == [free]
        with pytest.raises(ConfigurationError, match="only 1 of 2 ports are free"):
            free_ports(2)
