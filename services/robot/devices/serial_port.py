"""Open the port of a controller: a device, or a line over the network."""

import os
import socket
from typing import Protocol

import serial

from services.robot.core.tuning import CONTROLLER_LINE
from shared.errors import DeviceError

# Chosen: a reader ends at most this long after it was asked to.
READ_POLL_S = 0.05


class Port(Protocol):
    """What is used of pyserial."""

    def read(self, size: int = 1, /) -> bytes:
        """Up to `size` bytes; fewer after the time-out."""

    def write(self, data: bytes, /) -> int | None:
        """Hand bytes over."""

    def close(self) -> None:
        """Close."""


def open_port(url: str, baud: int) -> Port:
    """Open a device name or a pyserial URL (`/dev/ttyUSB0`, `socket://host:50000`, `rfc2217://host:port`).

    Raises
    ------
    DeviceError
        When it cannot be opened.
    """
    # pyserial's RFC 2217 refuses a time-out for writing: its socket's own, of some seconds, has to do.
    write_timeout_s = None if url.startswith("rfc2217://") else CONTROLLER_LINE.write_timeout_s
    try:
        port = serial.serial_for_url(
            url,
            baudrate=baud,
            timeout=READ_POLL_S,
            write_timeout=write_timeout_s,
            # Nobody else may write between our commands; a network's port server must see to that itself.
            exclusive=None if "://" in url else True,
        )
    except (serial.SerialException, OSError, ValueError) as error:
        raise DeviceError(
            f"the hexapod controller at '{url}' cannot be reached: {error}; check its power and cable, and that no "
            "other program holds the line"
        ) from None
    if url.startswith("socket://"):
        _send_at_once(port.fileno())
    return port


def _send_at_once(file_number: int) -> None:
    # Otherwise TCP may hold a stop back, up to 40 ms, until an earlier command has been acknowledged.
    with socket.socket(fileno=os.dup(file_number)) as same_connection:
        same_connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
