"""A relay carries bytes both ways until it is cut, and again when it is mended."""

import socket

from benchmarks.faults.line_relay import LineRelay, line_relay

_WITHIN_S = 60.0


def connected(relay: LineRelay) -> socket.socket:
    return socket.create_connection(("127.0.0.1", relay.port), timeout=_WITHIN_S)


def test_a_line_that_is_cut_hangs_up_and_takes_nobody_until_it_is_mended() -> None:
    with socket.create_server(("127.0.0.1", 0)) as controller, line_relay(controller.getsockname()[1]) as relay:
        controller.settimeout(_WITHIN_S)
        with connected(relay) as near:
            far, _ = controller.accept()
            with far:
                near.sendall(b"POS?\n")
                assert far.recv(16) == b"POS?\n"
                far.sendall(b"X=1\n")
                assert near.recv(16) == b"X=1\n"
                relay.cut()
                assert near.recv(16) == b""
                assert far.recv(16) == b""
        with connected(relay) as near:
            assert near.recv(16) == b""
        relay.mend()
        with connected(relay) as near:
            far, _ = controller.accept()
            with far:
                far.sendall(b"again")
                assert near.recv(16) == b"again"
