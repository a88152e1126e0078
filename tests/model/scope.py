"""What can happen in a search: few things at a time, each as often as it likes, so that every order is visited."""

from dataclasses import dataclass
from typing import Final

from services.ui_api.handlers.commands import PlainVerb


@dataclass(frozen=True, slots=True)
class Scope:
    """What can happen beside acknowledgements, references and stops.

    Attributes
    ----------
    on_their_way
        How many commands of one client can be on their way at the same time; when one more is sent, one is lost.
    pending
        How many operations of people can be pending at the same time.
    moves
        Whether plans are made and carried out.
    time
        Whether time passes, so that commands and permits expire. Only there a way out is looked for.
    silence
        Whether the gateway can fall silent while the robot moves.
    thief
        Whether another client sends permits that it has heard, or forged, under its own name.
    wires
        Whether wires are put in and taken out.
    gateway_ends, robot_ends
        Whether the gateway is killed and started again, as often as it likes, and the robot service, once.
    controller_fails
        Whether the controller loses power, and with it its reference; a reset then connects anew.
    disk_fills
        Whether the gateway's disk takes no entry.
    """

    name: str
    on_their_way: int = 1
    pending: int = 1
    moves: bool = False
    time: bool = False
    silence: bool = False
    thief: bool = False
    wires: bool = False
    gateway_ends: bool = False
    robot_ends: bool = False
    controller_fails: bool = False
    disk_fills: bool = False

    @property
    def verbs(self) -> tuple[PlainVerb, ...]:
        """Commands without a plan that people ask for: a reset does nothing where no controller fails."""
        return ("reference", "acknowledge_stop", *(("reset",) if self.controller_fails else ()))


SCOPES: Final = (
    Scope("late, lost and repeated commands", moves=True, time=True, silence=True),
    Scope("a controller that fails", controller_fails=True, time=True),
    Scope("another client", thief=True, time=True),
    Scope("wires", wires=True, time=True),
    Scope("wires, and a full disk", wires=True, disk_fills=True),
    Scope("wires, and a gateway that ends", wires=True, moves=True, gateway_ends=True),
    Scope("wires, and a robot service that ends", wires=True, robot_ends=True),
)
