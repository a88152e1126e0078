"""Everything at one moment: both services, the network between them, the hexapod, and what the properties speak of."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar, cast

from tests.model.gateway_memory import GatewayMemory, Notice
from tests.model.packets import Packet
from tests.model.plant import Plant
from tests.model.robot_memory import RobotMemory

T = TypeVar("T", bound=Hashable)
R = TypeVar("R")


class Box(Generic[T]):
    """A value that exists once: boxes are equal when they are the same, which costs nothing to find out."""

    __slots__ = ("value",)

    def __init__(self, value: T) -> None:
        self.value = value


class Boxes:
    """All values that were met, and what was worked out for them."""

    def __init__(self) -> None:
        self._boxes: dict[tuple[type, Hashable], Box[Any]] = {}
        self._results: dict[Hashable, object] = {}

    def __call__(self, value: T) -> Box[T]:
        """The box of a value."""
        key = (type(value), value)
        box = self._boxes.get(key)
        if box is None:
            box = self._boxes[key] = Box(value)
        return box

    def once(self, key: Hashable, work: Callable[[], R]) -> R:
        """The result of work that is determined by its key."""
        if key not in self._results:
            self._results[key] = work()
        return cast("R", self._results[key])


@dataclass(frozen=True, slots=True, order=True)
class OnItsWay:
    """A command that was sent and may arrive, any number of times.

    Attributes
    ----------
    carried_out
        Whether a motion has begun under its identifier.
    given_up
        Whether the gateway has recorded that it was never carried out.
    spent
        Whether its permit was taken before, whatever came of the motion.
    """

    packet: Packet
    carried_out: bool = False
    given_up: bool = False
    spent: bool = False


class World(NamedTuple):
    """A state of the model.

    Attributes
    ----------
    robot
        What the robot service remembers; None while it does not run.
    network
        Commands that may still arrive.
    notice
        A state of the robot on its way to the gateway.
    stop_holds
        Whether a stop has come, or a start, that nobody has acknowledged since.
    inside
        Whether a wire is in guide and bone.
    robot_ends
        Whether the robot service can still be killed: once, or the search would not end in two minutes.
    """

    robot: Box[RobotMemory | None]
    plant: Box[Plant]
    gateway: Box[GatewayMemory]
    network: Box[tuple[OnItsWay, ...]]
    notice: Box[Notice | None]
    stop_holds: bool
    inside: bool
    robot_ends: bool
