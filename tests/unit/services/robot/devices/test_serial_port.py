import os
import pty

import pytest

from services.robot.devices.serial_port import open_port
from shared.errors import DeviceError


def test_a_port_that_cannot_be_opened_is_reported() -> None:
    with pytest.raises(DeviceError, match=r"the hexapod controller at 'socket://127\.0\.0\.1:1' cannot be reached"):
        open_port("socket://127.0.0.1:1", 115200)
    with pytest.raises(DeviceError, match="cannot be reached"):
        open_port("/dev/no-such-device", 115200)


def test_a_device_that_another_program_holds_is_refused() -> None:
    _, terminal = pty.openpty()
    held = open_port(os.ttyname(terminal), 115200)
    with pytest.raises(DeviceError, match=r"cannot be reached: .*; check .* that no other program holds the line"):
        open_port(os.ttyname(terminal), 115200)
    held.close()
    open_port(os.ttyname(terminal), 115200).close()
