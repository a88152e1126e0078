"""The gateway's public port."""

import socket

from shared.errors import ConfigurationError

# Chosen: a burst of a console's and its viewers' connections; the kernel caps it (`somaxconn`).
_BACKLOG = 1024


def listening_socket(host: str, port: int) -> socket.socket:
    """A socket that listens; who connects before the server runs, waits.

    Raises
    ------
    ConfigurationError
        When the port is in use or the address is not this machine's.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Named, for asyncio sends small pieces at once only on sockets that say that they are TCP.
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise ConfigurationError(
            f"the REST interface cannot listen on {host} port {port} ({error.strerror or error}); end the program "
            "that holds it, or choose another with DISTALOCK_UI_API_PORT"
        ) from None
    return listening
