"""What services, hexapod and time do by themselves: they work, end, begin again, fall silent, and pass."""

from collections.abc import Iterator
from dataclasses import replace

from services.robot.core.status import UNDER_WAY
from tests.model.canonical import after_gateway_restart
from tests.model.gateway_memory import Acted, GatewayMemory, after_robot_restart
from tests.model.labels import EARLIER_GATEWAY, GATEWAY, THIS_BOOT, Quote
from tests.model.network import sent
from tests.model.plans import PlanName
from tests.model.plant import Doing
from tests.model.search import Step
from tests.model.services import Services, up
from tests.model.world import World


def gateway_by_itself(services: Services, world: World) -> Iterator[Step[World]]:
    """The gateway sends, gives up waiting, is killed and started again."""
    memory, boxes = world.gateway.value, services.boxes
    if not memory.is_up:
        acted = boxes.once(("start", world.gateway), lambda: services.gateway.restarted(memory))
        yield services.after_gateway(world, acted, "the gateway is started again", helps=True)
        return
    if memory.queue and memory.sending is None:
        acted = boxes.once(("send", world.gateway), lambda: services.gateway.send(memory))
        yield from sent(services, world, acted)
    if memory.sending is not None:
        acted = boxes.once(("answer", world.gateway, None), lambda: services.gateway.answered(memory, None))
        yield services.after_gateway(world, acted, "no answer arrives in time", helps=True)
    # Without anything pending nothing is lost that the record does not give back.
    if services.scope.gateway_ends and (memory.pending or memory.queue):
        yield _gateway_killed(services, world)


def _gateway_killed(services: Services, world: World) -> Step[World]:
    memory, robot, boxes = world.gateway.value, world.robot.value, services.boxes
    network = tuple(replace(one, packet=after_gateway_restart(one.packet)) for one in world.network.value)
    if robot is not None:
        newest = tuple((("gateway-0" if client == GATEWAY else client), number) for client, number in robot.newest)
        robot = replace(robot, newest=newest, heard=EARLIER_GATEWAY if robot.heard else None)
    left = GatewayMemory(is_up=False, case=memory.case, operations=memory.pending)
    killed = world._replace(robot=boxes(robot), network=boxes(network), notice=boxes(None))
    return services.after_gateway(killed, Acted(left), "the gateway is killed")


def robot_by_itself(services: Services, world: World) -> Iterator[Step[World]]:
    """The hexapod ends its motion; the robot service connects, begins, hears, misses, fails, is killed and started."""
    robot, plant, boxes = world.robot.value, world.plant.value, services.boxes
    if plant.doing is not Doing.NOTHING:
        yield _motion_ended(services, world)
    if robot is None:
        yield _robot_started(services, world)
        return
    if not robot.connected:
        yield services.after_robot(world, services.work(world), "the robot service connects", helps=True)
    elif robot.pending:
        yield services.after_robot(world, services.work(world), "the worker begins the motion", helps=True)
        ran = boxes.once(("stopped", world.robot, world.plant), lambda: services.robot.work_while_stopped(robot, plant))
        yield services.after_robot(world, ran, "a stop arrives just as the worker begins the motion")
    yield from _heard(services, world)
    if services.scope.controller_fails and robot.connected:
        ran = boxes.once(("fail", world.robot, world.plant), lambda: services.robot.fail(robot, plant))
        yield services.after_robot(world, ran, "the controller loses power")
    if world.robot_ends and robot.connected:
        killed = world._replace(robot=boxes(None), notice=boxes(None), robot_ends=False)
        yield Step("the robot service is killed", services.tidied(killed))


def _motion_ended(services: Services, world: World) -> Step[World]:
    ended = world._replace(plant=services.boxes(world.plant.value.ended()))
    label = "the motion comes to its end"
    if world.robot.value is None:
        return Step(label, ended, (), helps=True)
    return services.after_robot(ended, services.work(ended), label, helps=True)


def _heard(services: Services, world: World) -> Iterator[Step[World]]:
    robot, plant, boxes = up(world), world.plant.value, services.boxes
    is_up = world.gateway.value.is_up
    if is_up and robot.heard != GATEWAY:
        ran = boxes.once(("hear", world.robot, world.plant), lambda: services.robot.hear(robot, plant))
        yield services.after_robot(world, ran, "the gateway is heard", helps=True)
    # At rest, silence of a gateway that is there only refuses: it is left out.
    is_missed = robot.status.state in UNDER_WAY if is_up else services.scope.time
    if robot.heard and is_missed and (services.scope.silence or not is_up):
        ran = boxes.once(("miss", world.robot, world.plant), lambda: services.robot.miss(robot, plant))
        yield services.after_robot(world, ran, "the gateway is heard no more")


def _robot_started(services: Services, world: World) -> Step[World]:
    boxes = services.boxes
    inside = bool(world.gateway.value.case.progress.inside)
    network = tuple(replace(one, packet=one.packet.after_restart()) for one in world.network.value)
    started = world._replace(
        robot=boxes(services.robot.started(PlanName.OF_EARLIER_BOOT, inside=inside)),
        gateway=boxes(after_robot_restart(world.gateway.value)),
        network=boxes(network),
        stop_holds=True,
    )
    return Step("the robot service is started again", services.tidied(started), (), helps=True)


def time_passes(services: Services, world: World) -> Iterator[Step[World]]:
    """Longer than any command lives; whoever has something to do at once has done it before."""
    robot, gateway, boxes = world.robot.value, world.gateway.value, services.boxes
    if not services.scope.time:
        return
    if gateway.is_up and (gateway.sending or gateway.queue):
        return
    if robot is not None and (robot.pending or (robot.heard and not gateway.is_up)):
        return
    living = tuple(one for one in world.network.value if _lives_on(one.packet.quote, one.packet.boot))
    if robot is not None:
        robot = replace(robot, used=tuple((nonce, True) for nonce, _ in robot.used))
    aged = services.aged(world._replace(robot=boxes(robot), network=boxes(living), notice=boxes(None)), Quote.later)
    gateway = replace(aged.gateway.value, seen=None)
    yield Step("time passes", services.tidied(aged._replace(gateway=boxes(gateway))), (), helps=True)


def _lives_on(quote: Quote, boot: str) -> bool:
    """A command is on its way for two periods at most."""
    return quote is Quote.NEW and boot == THIS_BOOT
