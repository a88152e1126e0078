"""`python -m services.robot`: the robot service. The only place that builds its adapters."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict

from services.robot.core.permits import Permit
from services.robot.core.refusals import Refusal
from services.robot.core.status import DriveStatus
from services.robot.devices.controller import HexapodController
from services.robot.devices.dialects import DIALECTS
from services.robot.devices.guardian import Guardian, hosted_at
from services.robot.devices.serial_port import open_port
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
from shared.scheduling import keep_collections_short, take_precedence
from shared.signals import parent_silent_for_s


@contextmanager
def compose(settings: RobotSettings, bus: Bus, runtime: Runtime) -> Iterator[RobotService]:
    """Build the service and run it for as long as the context lasts."""
    hexapod = _hexapod(settings)
    permit_verifier = settings.permit_verifier()
    guardian = Guardian(hosted_at(settings.guardian_socket) if settings.guardian_socket else None)

    def connect() -> HexapodController:
        port = open_port(settings.controller_url, settings.controller_baud)
        return DIALECTS[settings.dialect].driver(port, hexapod, settings.encoders, settings.reply_timeout_s, guardian)

    drive = Drive(
        connect,
        settings.reference_travel(),
        time.monotonic,
        settings.retry_s,
        runtime.fail,
        settings.initial_stop_button(),
        guardian,
    )

    runtime.first_on_fault.append(drive.fail)

    def note_change(status: DriveStatus) -> None:
        runtime.log.info("state", state=status.state, detail=status.detail, command_id=status.command_id)
        if status.state in (MotionState.DISCONNECTED, MotionState.FAULT):
            runtime.degraded(status.detail)
        else:
            runtime.ready(status.detail)

    def note_permit(outcome: Permit | Refusal, sha256: str) -> None:
        if isinstance(outcome, Refusal):
            runtime.log.warning("permit refused", code=outcome.code.value, detail=outcome.message, permit=sha256)
        else:
            runtime.log.info("permit taken", permit=sha256, **asdict(outcome))

    parts = RobotParts(
        hexapod=hexapod,
        limits=settings.guard_limits(),
        drive=drive,
        boot_epoch=runtime.boot_epoch,
        clock_s=time.monotonic,
        note_change=note_change,
        permit_verifier=permit_verifier,
        note_permit=note_permit,
        silent_for_s={"what started the robot service": parent_silent_for_s},
    )
    with RobotService(bus, runtime.keys, parts) as service:
        yield service


def _hexapod(settings: RobotSettings) -> HexapodPart:
    try:
        return hexapod_from_json(read_part_file(settings.hexapod_file), str(settings.hexapod_file))
    except PartFileInvalid as error:
        raise ConfigurationError(str(error)) from None


if __name__ == "__main__":
    take_precedence()
    keep_collections_short()
    sys.exit(service_main("robot", RobotSettings, compose))
