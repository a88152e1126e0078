"""What a procedure needs of a running installation, be it processes or containers, to be led through faults."""

from typing import Protocol

from benchmarks.faults.acknowledged import Acknowledged
from benchmarks.faults.hexapod import Hexapod
from distalock.rest_client import RestClient
from distalock.room_client import RoomClient


class Hands(Protocol):
    """The virtual operating room."""

    @property
    def control(self) -> RestClient:
        """Its control API."""
        ...

    @property
    def room(self) -> RoomClient:
        """What hands do in it."""
        ...


class ProcedureSite(Protocol):
    """An installation with a virtual operating room."""

    @property
    def room(self) -> Hands:
        """The room."""
        ...

    @property
    def acknowledged(self) -> Acknowledged:
        """What the installation has acknowledged."""
        ...

    def hexapod(self) -> Hexapod:
        """The truth about the robot."""
        ...
