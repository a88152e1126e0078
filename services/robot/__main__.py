"""`python -m services.robot`: the robot service. The only place that builds its adapters."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from services.robot.core.status import DriveStatus
from services.robot.devices.controller import HexapodController
from services.robot.devices.dialects import DRIVERS
from services.robot.devices.serial_line import open_port
from services.robot.drive.drive import Drive
from services.robot.service import RobotParts, RobotService
from services.robot.settings import RobotSettings
from shared.bus.port import Bus
from shared.errors import ConfigurationError, PartFileInvalid
from shared.geometry.hexapod import HexapodPart
from shared.parts.files import read_part_file
from shared.parts.hexapod_file import hexapod_from_json
from shared.robot_states import MotionState
from shared.runtime.lifecycle import Runtime, service_main


@contextmanager
def compose(settings: RobotSettings, bus: Bus, runtime: Runtime) -> Iterator[RobotService]:
    """Build the service and run it for as long as the context lasts."""
    hexapod = _hexapod(settings)

    def connect() -> HexapodController:
        port = open_port(settings.controller_url, settings.controller_baud)
        return DRIVERS[settings.dialect](port, hexapod, settings.encoders, settings.reply_timeout_s)

    drive = Drive(
        connect,
        settings.reference_travel(),
        time.monotonic,
        settings.retry_s,
        runtime.fail,
        settings.initial_stop_button(),
    )

    runtime.first_on_fault.append(drive.fail)

    def note_change(status: DriveStatus) -> None:
        runtime.log.info("state", state=status.state, detail=status.detail, command_id=status.command_id)
        if status.state in (MotionState.DISCONNECTED, MotionState.FAULT):
            runtime.degraded(status.detail)
        else:
            runtime.ready(status.detail)

    parts = RobotParts(hexapod, settings.guard_limits(), drive, runtime.boot_epoch, time.monotonic, note_change)
    with RobotService(bus, runtime.keys, parts) as service:
        yield service


def _hexapod(settings: RobotSettings) -> HexapodPart:
    try:
        return hexapod_from_json(read_part_file(settings.hexapod_file), str(settings.hexapod_file))
    except PartFileInvalid as error:
        raise ConfigurationError(str(error)) from None


if __name__ == "__main__":
    sys.exit(service_main("robot", RobotSettings, compose))
