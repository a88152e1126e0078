"""The wires that the virtual controller is served on."""

import socket
from contextlib import ExitStack

import pytest
import serial

from shared.errors import ConfigurationError
from shared.parts.hexapod_file import default_hexapod
from simulation.controller.servers import MOST_CLIENTS, tcp_server, terminal_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.wire import PATIENCE_S, Clock, Line


def test_tcp_and_terminal_share_one_robot() -> None:
    clock = Clock()
    controller = VirtualController(default_hexapod(), clock)
    with tcp_server(controller) as port, terminal_server(controller) as path, ExitStack() as stack:
        lines = [
            Line(stack.enter_context(serial.serial_for_url(url, timeout=PATIENCE_S)))
            for url in (f"socket://127.0.0.1:{port}", path)
        ]
        assert lines[0].tell("SVO X 1") == 0
        assert lines[1].ask("SVO? X") == "X=1\n"


def test_too_many_clients_are_hung_up_on_and_places_are_given_back() -> None:
    controller = VirtualController(default_hexapod(), Clock())
    with tcp_server(controller) as port, ExitStack() as stack:
        address = ("127.0.0.1", port)
        clients = [stack.enter_context(socket.create_connection(address, PATIENCE_S)) for _ in range(MOST_CLIENTS)]
        for client in clients:
            client.sendall(b"CSV?\n")
            assert client.recv(16) == b"2.0\n"
        with socket.create_connection(address, PATIENCE_S) as refused:
            assert refused.recv(1) == b""
        clients[0].shutdown(socket.SHUT_WR)
        assert clients[0].recv(1) == b""
        with socket.create_connection(address, PATIENCE_S) as admitted:
            admitted.sendall(b"CSV?\n")
            assert admitted.recv(16) == b"2.0\n"


def test_port_in_use_is_one_sentence() -> None:
    controller = VirtualController(default_hexapod(), Clock())
    with tcp_server(controller) as port:
        sentence = rf"cannot listen at 127\.0\.0\.1:{port}: Address already in use; stop the program"
        with pytest.raises(ConfigurationError, match=sentence), tcp_server(controller, port=port):
            pass
