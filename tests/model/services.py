"""Both services at work on the world: what follows from an event at one of them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from services.robot.core.motion import Effect
from tests.model.canonical import tidied
from tests.model.gateway_memory import Acted, GatewayMemory, Notice, with_quotes
from tests.model.gateway_side import GatewaySide
from tests.model.labels import Quote, QuoteChange
from tests.model.properties import Property, broken_in
from tests.model.robot_memory import Ran, RobotMemory
from tests.model.robot_side import RobotSide
from tests.model.scope import Scope
from tests.model.search import Step
from tests.model.world import Box, Boxes, OnItsWay, World

_STARTS: Final = (Effect.START_MOVE, Effect.START_REFERENCE)


class Services:
    """The services that run, and what was worked out of them so far."""

    def __init__(self, scope: Scope) -> None:
        self.scope = scope
        self.robot, self.gateway, self.boxes = RobotSide(), GatewaySide(), Boxes()

    def after_gateway(self, world: World, acted: Acted, label: str, *, helps: bool = False) -> Step[World]:
        """The step after which the gateway remembers something else."""
        broken: list[str] = []
        never_began = {slot for slot, began in acted.ended if not began}
        network = world.network.value
        if never_began:
            broken += [Property.GIVEN_UP for one in network if one.packet.slot in never_began and one.carried_out]
            network = tuple(replace(one, given_up=one.given_up or one.packet.slot in never_began) for one in network)
        after = world._replace(gateway=self.boxes(acted.memory), network=self.boxes(network))
        return Step(label, self.tidied(after), tuple(broken), helps)

    def after_robot(
        self,
        world: World,
        ran: Ran,
        label: str,
        broken: Sequence[str] = (),
        notice: Box[Notice | None] | None = None,
        *,
        helps: bool = False,
    ) -> Step[World]:
        """The step after which the robot service remembers something else, and the hexapod may do something else."""
        found = list(broken)
        if ran.began:
            found += _broken_by_motion(world, ran)
            slot = ran.memory.status.command_id
            network = (
                replace(one, carried_out=one.carried_out or one.packet.slot == slot) for one in world.network.value
            )
            world = world._replace(network=self.boxes(tuple(network)))
        world = world._replace(
            robot=self.boxes(ran.memory), plant=self.boxes(ran.plant), notice=notice or self.boxes(None)
        )
        if ran.stopped:
            world = self.aged(world._replace(stop_holds=True), Quote.after_stop)
        found += broken_in(world)
        again = self._next_round(world)
        if again is not None:
            return self.after_robot(world, again, label, found, notice, helps=helps)
        return Step(label, self.tidied(world), tuple(found), helps)

    def _next_round(self, world: World) -> Ran | None:
        """The worker's next round, which comes at once: unless it begins a motion, or connects."""
        robot, plant = world.robot.value, world.plant.value
        assert robot is not None
        if not robot.connected or any(effect in _STARTS for effect in robot.pending):
            return None
        ran = self.work(world)
        return None if (ran.memory, ran.plant) == (robot, plant) else ran

    def work(self, world: World) -> Ran:
        """A round of the robot service's worker."""
        robot, plant = up(world), world.plant.value
        return self.boxes.once(("work", world.robot, world.plant), lambda: self.robot.work(robot, plant))

    def published(self, world: World) -> Box[Notice | None]:
        """The robot's state as it is published now."""
        robot, plant = up(world), world.plant.value

        def work() -> Box[Notice | None]:
            return self.boxes(Notice.of(self.robot.publish(robot, plant)))

        return self.boxes.once(("publish", world.robot, world.plant), work)

    def aged(self, world: World, change: QuoteChange) -> World:
        """After time has passed, or a stop has come: what was seen before is older by that."""

        def work() -> Box[GatewayMemory]:
            return self.boxes(with_quotes(world.gateway.value, change))

        gateway = self.boxes.once(("age", world.gateway, change.__name__), work)
        network = tuple(replace(one, packet=one.packet.aged(change)) for one in world.network.value)
        notice = world.notice.value and world.notice.value.aged(change)
        return world._replace(gateway=gateway, network=self.boxes(network), notice=self.boxes(notice))

    def tidied(self, world: World) -> World:
        """The one that stands for all that differ from it in names alone."""

        def work() -> tuple[Box[RobotMemory | None], Box[GatewayMemory], Box[tuple[OnItsWay, ...]], Box[Notice | None]]:
            robot, gateway, network, notice = tidied(
                world.robot.value, world.gateway.value, world.network.value, world.notice.value
            )
            return self.boxes(robot), self.boxes(gateway), self.boxes(network), self.boxes(notice)

        key = ("tidy", world.robot, world.gateway, world.network, world.notice)
        robot, gateway, network, notice = self.boxes.once(key, work)
        return world._replace(robot=robot, gateway=gateway, network=network, notice=notice)


def up(world: World) -> RobotMemory:
    """What the robot service remembers, which runs."""
    memory: RobotMemory | None = world.robot.value
    assert memory is not None
    return memory


def _broken_by_motion(world: World, ran: Ran) -> list[Property]:
    slot = ran.memory.status.command_id
    again = any(one.carried_out and one.packet.slot == slot for one in world.network.value)
    return [Property.STOP] * world.stop_holds + [Property.INSIDE] * world.inside + [Property.ONCE] * again
