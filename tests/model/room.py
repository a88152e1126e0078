"""The model for the search: where it starts, what can happen, and what counts as a way out."""

from collections.abc import Iterator

from shared.robot_states import MotionState
from tests.model.by_themselves import gateway_by_itself, robot_by_itself, time_passes
from tests.model.network import network
from tests.model.people import people, stop_by_gateway
from tests.model.plans import PlanName
from tests.model.plant import Plant
from tests.model.properties import Property, broken_in
from tests.model.robot_memory import RobotMemory
from tests.model.scope import Scope
from tests.model.search import Model, Step
from tests.model.services import Services
from tests.model.world import Box, World


def room_model(scope: Scope) -> Model[World]:
    """A room with one robot service, one gateway and their people."""
    services = Services(scope)
    return Model(
        starts=_starts(services),
        steps=lambda world: _steps(services, world),
        broken=broken_in,
        # Where no time passes, a command that was lost stays pending for ever.
        is_goal=_is_goal if scope.time else _anything,
        describe=describe,
        goal_name=Property.WAY_OUT,
    )


def _starts(services: Services) -> tuple[World, ...]:
    """Both services have just been started; the axes are referenced, or not."""
    boxes = services.boxes
    robot: Box[RobotMemory | None] = boxes(services.robot.started(PlanName.CURRENT, inside=False))
    gateway = boxes(services.gateway.started())
    return tuple(
        World(
            robot=robot,
            plant=boxes(Plant(referenced=is_referenced)),
            gateway=gateway,
            network=boxes(()),
            notice=boxes(None),
            stop_holds=True,
            inside=False,
            robot_ends=services.scope.robot_ends,
        )
        for is_referenced in (True, False)
    )


def _steps(services: Services, world: World) -> Iterator[Step[World]]:
    memory = world.gateway.value
    if memory.queue and memory.sending is None:
        # Sending commutes with all that the robot does: only what happens at the gateway can come before it.
        yield from stop_by_gateway(services, world)
        yield from gateway_by_itself(services, world)
        return
    yield from people(services, world)
    yield from gateway_by_itself(services, world)
    yield from network(services, world)
    yield from robot_by_itself(services, world)
    yield from time_passes(services, world)


def _is_goal(world: World) -> bool:
    robot, gateway = world.robot.value, world.gateway.value
    is_locked = robot is not None and robot.status.state is MotionState.LOCKED and not robot.pending
    return is_locked and not world.stop_holds and not world.inside and gateway.is_up and not gateway.pending


def _anything(world: World) -> bool:
    return True


def describe(world: World) -> str:
    """A state in one line."""
    robot, gateway, plant = world.robot.value, world.gateway.value, world.plant.value
    pending = ", ".join(f"{o.requested.operation_id} {o.requested.verb} {o.status}" for o in gateway.pending)
    packets = ", ".join(
        f"{one.packet.slot} {one.packet.verb} of {one.packet.client} quoting {one.packet.quote.name}"
        for one in world.network.value
    )
    parts = [
        f"robot {'down' if robot is None else robot.status.state.value}",
        f"hexapod {plant.doing.value}",
        f"gateway {'up' if gateway.is_up else 'down'}, {gateway.case.progress.stage.value}",
        *([f"pending: {pending}"] if pending else []),
        *([f"on its way: {packets}"] if packets else []),
        *(["stop holds"] if world.stop_holds else []),
        *(["wire inside"] if world.inside else []),
    ]
    return "; ".join(parts)
