"""The dialects of hexapod controllers: the one table in which a driver is registered."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from services.robot.devices.controller import Encoders, HexapodController
from services.robot.devices.gcs import codec
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.guardian import LineGuardian
from services.robot.devices.serial_port import Port
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
    identity_question
        What a controller answers with one line that names it, and changes nothing (`identity.asked_identity`).
    """

    driver: Driver
    identity_question: bytes


DIALECTS: Mapping[Dialect, DialectDevice] = {Dialect.GCS: DialectDevice(GcsController, codec.query("*IDN"))}
