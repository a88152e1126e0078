"""The dialects of hexapod controllers: the one table in which a driver is registered."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from services.robot.devices.controller import Encoders, HexapodController
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.gcs.identity import asked_identity
from services.robot.devices.guardian import LineGuardian
from services.robot.devices.serial_line import Port
from shared.geometry.hexapod import HexapodPart


class Dialect(StrEnum):
    """Protocols that the robot service speaks; the setting `dialect` names one."""

    GCS = "gcs"


class Driver(Protocol):
    """Takes over a port: returns a controller that was found or made stopped and locked; raises `DeviceError`."""

    def __call__(
        self,
        port: Port,
        hexapod: HexapodPart,
        encoders: Encoders,
        reply_timeout_s: float,
        guardian: LineGuardian,
    ) -> HexapodController:
        """Connect."""


@dataclass(frozen=True, slots=True)
class DialectDevice:
    """How a controller of a dialect is reached.

    Attributes
    ----------
    driver
        Takes over the controller.
    ask_identity
        For whoever only wants to know who is there: a port and the seconds to wait in, what it answers out.
    """

    driver: Driver
    ask_identity: Callable[[Port, float], str]


DIALECTS: Mapping[Dialect, DialectDevice] = {Dialect.GCS: DialectDevice(GcsController, asked_identity)}
