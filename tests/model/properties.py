"""What must hold, in words and as a formula: `docs/safety.md` prints this table, the search checks it."""

from dataclasses import dataclass
from enum import StrEnum

from services.robot.core.motion import stop_is_latched
from tests.model.plant import Doing
from tests.model.world import World


class Property(StrEnum):
    """Names of the properties."""

    PERMIT = "permit"
    STOP = "stop"
    INSIDE = "inside"
    ONCE = "once"
    LATE = "late"
    RECORDED = "recorded"
    GIVEN_UP = "given up"
    STOPPABLE = "stoppable"
    WAY_OUT = "way out"


@dataclass(frozen=True, slots=True)
class Statement:
    """A property for readers."""

    words: str
    formula: str


STATEMENTS = {
    Property.PERMIT: Statement(
        "No motion begins but with a permit that the gateway signed for it, not used before, not expired, of this run "
        "of the robot service, from after the last stop",
        "□(begins(m) ⇒ ∃p: valid(p, m) ∧ ¬used(p))",
    ),
    Property.STOP: Statement(
        "Nothing moves after a stop, or after a start of the robot service, before a person has acknowledged it; an "
        "acknowledgement, or any other command, that was asked for before a stop has no effect after it",
        "□(stop ⇒ (¬motion ∧ latched) W acknowledged)",
    ),
    Property.INSIDE: Statement("Nothing moves while a wire, drill or screw is in guide or bone", "□(inside ⇒ ¬motion)"),
    Property.ONCE: Statement(
        "At most one motion begins under the identifier of a command", "□(begun(id) ⇒ □¬begins(id))"
    ),
    Property.LATE: Statement(
        "No command has an effect later than its time to live allows, or in another run of the robot service",
        "□(effect(c) ⇒ age(c) ≤ ttl(c) ∧ boot(c) = boot)",
    ),
    Property.RECORDED: Statement("The gateway sends no command that is not on record", "□(sent(id) ⇒ recorded(id))"),
    Property.GIVEN_UP: Statement(
        "What the gateway has recorded as not carried out is not carried out, before or after",
        "□(given_up(id) ⇒ □¬begun(id))",
    ),
    Property.STOPPABLE: Statement(
        "A stop is possible in every state, and afterwards nothing moves and the stop is in force",
        "□(stop ⇒ ○(¬motion ∧ latched))",
    ),
    Property.WAY_OUT: Statement(
        "From every reachable state people can bring the robot back to `locked`, without a stop, with nothing inside "
        "and no command pending",
        "AG EF (locked ∧ ¬stop ∧ ¬inside ∧ ¬pending)",
    ),
}


def broken_in(world: World) -> tuple[Property, ...]:
    """Properties that a state breaks, whatever step led to it."""
    plant, robot = world.plant.value, world.robot.value
    moves = plant.doing is not Doing.NOTHING
    broken = []
    if (
        world.stop_holds
        and robot is not None
        and (not stop_is_latched(robot.status.state) or (moves and robot.connected))
    ):
        broken.append(Property.STOP)
    if world.inside and moves:
        broken.append(Property.INSIDE)
    return tuple(broken)
