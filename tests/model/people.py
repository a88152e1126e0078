"""What people do: they ask for commands and stops, put wires in and take them out, take images and approve plans."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final

from services.robot.core.status import UNDER_WAY
from services.ui_api.core.event_data import Step as Hands
from services.ui_api.core.procedure import Aim
from services.ui_api.handlers.commands import PlainVerb
from shared.robot_states import MotionState
from tests.model.canonical import free_slot, next_number
from tests.model.gateway_memory import Acted, GatewayMemory, with_plan
from tests.model.plans import PlanName
from tests.model.plant import Doing
from tests.model.properties import Property
from tests.model.search import Step
from tests.model.services import Services, up
from tests.model.world import World

_STOPPED: Final = (MotionState.STOPPED, MotionState.FAULT, MotionState.DISCONNECTED)

Ask = Callable[[str, int, bool], Acted | None]


def people(services: Services, world: World) -> Iterator[Step[World]]:
    """Every step of people."""
    memory = world.gateway.value
    if memory.is_up:
        if len(memory.pending) < services.scope.pending:
            yield from _commands(services, world)
        if services.scope.wires:
            yield from _wires(services, world)
        if services.scope.moves and not _plan_is_ready(memory):
            yield from _planned(services, world)
    if world.robot.value is not None:
        yield stop(services, world, "a stop arrives at the robot")


def stop_by_gateway(services: Services, world: World) -> Iterator[Step[World]]:
    """A stop over REST: it reaches the robot or is lost, and no command that waits is sent any more."""
    acted = services.gateway.stop(world.gateway.value)
    stopped = world._replace(gateway=services.boxes(acted.memory))
    if stopped.gateway is world.gateway:
        return
    yield Step("somebody asks for a stop, which is lost", stopped)
    if world.robot.value is not None:
        yield stop(services, stopped, "somebody asks for a stop")


def stop(services: Services, world: World, label: str) -> Step[World]:
    """A stop arrives at the robot service."""
    robot, plant = up(world), world.plant.value
    ran = services.boxes.once(("stop", world.robot, world.plant), lambda: services.robot.stop(robot, plant))
    state = ran.memory.status.state
    moves = state in UNDER_WAY or (ran.plant.doing is not Doing.NOTHING and ran.memory.connected)
    broken = [Property.STOPPABLE] if moves or state not in _STOPPED else []
    return services.after_robot(world._replace(stop_holds=True), ran, label, broken)


def _commands(services: Services, world: World) -> Iterator[Step[World]]:
    memory, gateway = world.gateway.value, services.gateway

    def move(slot: str, number: int, is_full: bool) -> Acted | None:  # noqa: FBT001 - `Ask`
        return gateway.begin_move(memory, slot, number, is_full=is_full)

    def plain(verb: PlainVerb) -> Ask:
        return lambda slot, number, is_full: gateway.begin_plain(memory, verb, slot, number, is_full=is_full)

    if services.scope.moves:
        yield from _asked(services, world, "move", move)
    for verb in services.scope.verbs:
        yield from _asked(services, world, verb, plain(verb))


def _asked(services: Services, world: World, verb: str, ask: Ask) -> Iterator[Step[World]]:
    memory, network = world.gateway.value, world.network.value
    slot, number = free_slot(memory, network), next_number(memory, network)
    for is_full in (False, True) if services.scope.disk_fills else (False,):
        key = (verb, world.gateway, slot, number, is_full)
        acted = services.boxes.once(key, partial(ask, slot, number, is_full))
        if acted is not None:
            label = f"somebody asks for {verb}" + (", and the disk is full" if is_full else "")
            yield services.after_gateway(world, acted, label, helps=not is_full)


def _wires(services: Services, world: World) -> Iterator[Step[World]]:
    memory = world.gateway.value
    step = Hands.WIRES_REMOVED if world.inside else Hands.WIRES_INSERTED
    acted = services.boxes.once((step, world.gateway), lambda: services.gateway.record_step(memory, step))
    if acted is not None:
        after = world._replace(inside=not world.inside)
        yield services.after_gateway(after, acted, f"somebody reports {step.value}", helps=world.inside)


def _planned(services: Services, world: World) -> Iterator[Step[World]]:
    memory, robot = world.gateway.value, world.robot.value
    acted = services.boxes.once(("plan", world.gateway), lambda: services.gateway.plan_anew(memory))
    if acted is None:
        return
    queue = tuple((packet.after_new_plan(), stopped) for packet, stopped in acted.memory.queue)
    network = tuple(replace(one, packet=one.packet.after_new_plan()) for one in world.network.value)
    known = world._replace(
        robot=services.boxes(None if robot is None else replace(robot, plan=PlanName.CURRENT, begun=False)),
        network=services.boxes(network),
    )
    acted = replace(acted, memory=replace(acted.memory, queue=queue))
    yield services.after_gateway(known, acted, "an image is taken, a plan made and approved", helps=True)


def _plan_is_ready(memory: GatewayMemory) -> bool:
    if not memory.case.plans or memory.case.progress.aim is not Aim.APPROVED:
        return False
    entry = memory.case.plans[0]
    is_current = entry == with_plan(memory, PlanName.CURRENT).case.plans[0]
    return is_current and entry.approval is not None and not entry.used
