"""What the network does: commands arrive, twice, late or never; another client sends what it has heard of them."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from shared.robot_states import MotionState
from tests.model.canonical import free_slot
from tests.model.gateway_memory import Acted, Notice
from tests.model.labels import GATEWAY, THIS_BOOT, Quote
from tests.model.packets import Packet
from tests.model.permits import Permission
from tests.model.plans import PlanName
from tests.model.properties import Property
from tests.model.robot_memory import Ran, Reply
from tests.model.search import Step
from tests.model.services import Services, up
from tests.model.world import Box, OnItsWay, World

THIEF: Final = "thief"
_MOTIONS: Final = (MotionState.MOVING, MotionState.REFERENCING)


def network(services: Services, world: World) -> Iterator[Step[World]]:
    """Every step of the network."""
    if world.robot.value is None:
        return
    for one in world.network.value:
        yield from _arrives(services, world, one)
    if world.gateway.value.is_up:
        yield _received(services, world, services.published(world), "the robot's state reaches the gateway")
        if world.notice.value is not None:
            yield _received(services, world, world.notice, "an earlier state of the robot reaches the gateway")
        if services.scope.wires and up(world).inside != _is_recorded_inside(world):
            yield _case_heard(services, world)
    if services.scope.thief:
        yield from _thief(services, world)


def sent(services: Services, world: World, acted: Acted) -> Iterator[Step[World]]:
    """The gateway's sender has taken a command: it is on its way now, or was not sent."""
    if acted.sent is None:
        yield services.after_gateway(world, acted, "the gateway does not send the command", helps=True)
        return
    recorded = {o.requested.operation_id for o in world.gateway.value.operations}
    broken = () if acted.sent.slot in recorded else (Property.RECORDED,)
    for after, lost in _with(services, world, acted.sent):
        step = services.after_gateway(after, acted, f"the gateway sends {acted.sent.verb}{lost}", helps=True)
        yield replace(step, broken=step.broken + broken)


def _with(services: Services, world: World, packet: Packet) -> Iterator[tuple[World, str]]:
    """With one more command on its way; when there are too many, one of them is lost."""
    before = world.network.value
    own = tuple(one for one in before if (one.packet.client == THIEF) == (packet.client == THIEF))
    for lost in own if len(own) >= services.scope.on_their_way else (None,):
        left = tuple(one for one in before if one is not lost)
        nonces = {permit.nonce for permit in packet.permits}
        spent = any(one.spent and nonces & {p.nonce for p in one.packet.permits} for one in before)
        label = "" if lost is None else f", {lost.packet.verb} is lost"
        yield world._replace(network=services.boxes((*left, OnItsWay(packet, spent=spent)))), label


def _arrives(services: Services, world: World, one: OnItsWay) -> Iterator[Step[World]]:
    robot, plant, packet = up(world), world.plant.value, one.packet
    ran = services.boxes.once((packet, world.robot, world.plant), lambda: services.robot.deliver(robot, plant, packet))
    step = _delivered(services, world, one, ran)
    yield step
    memory = world.gateway.value
    if memory.sending is not None and memory.sending[0] == packet.slot and packet.client == GATEWAY:
        yield _answered(services, step, ran.reply)


def _delivered(services: Services, world: World, one: OnItsWay, ran: Ran) -> Step[World]:
    packet = one.packet
    label = f"{packet.verb} arrives at the robot" + (" from the other client" if packet.client == THIEF else "")
    if ran.taken:
        world = _with_spent(services, world, set(ran.taken))
    if ran.memory.status.state is up(world).status.state:
        return services.after_robot(world, ran, label, helps=True)
    broken = _broken_by_effect(one, ran)
    if packet.verb == "acknowledge_stop":
        world = world._replace(stop_holds=False)
    # What was published just before may reach the gateway after the answer.
    overtaken = services.published(world) if world.gateway.value.pending else None
    return services.after_robot(world, ran, label, broken, overtaken, helps=True)


def _with_spent(services: Services, world: World, nonces: set[str]) -> World:
    """A permit that was taken is used, whatever came of the motion."""
    network = (
        replace(one, spent=one.spent or any(permit.nonce in nonces for permit in one.packet.permits))
        for one in world.network.value
    )
    return world._replace(network=services.boxes(tuple(network)))


def _broken_by_effect(one: OnItsWay, ran: Ran) -> list[str]:
    packet = one.packet
    broken: list[str] = [Property.LATE] * (packet.quote.is_late or packet.boot != THIS_BOOT)
    broken += [Property.STOP] * packet.quote.is_before_stop + [Property.GIVEN_UP] * one.given_up
    if ran.memory.status.state in _MOTIONS:
        broken += [Property.PERMIT] * (one.spent or not _is_permitted(packet))
    return broken


def _is_permitted(packet: Packet) -> bool:
    return any(
        permit.genuine
        and permit.nothing_inside
        and (permit.motion, permit.plan, permit.boot) == (packet.verb, packet.plan, THIS_BOOT)
        and not permit.quote.is_late
        and not permit.quote.is_before_stop
        for permit in packet.permits
    )


def _answered(services: Services, step: Step[World], reply: Reply | None) -> Step[World]:
    world = step.after
    acted = services.boxes.once(
        ("answer", world.gateway, reply), lambda: services.gateway.answered(world.gateway.value, reply)
    )
    answered = services.after_gateway(world, acted, f"{step.label}, which answers", helps=True)
    return replace(answered, broken=step.broken + answered.broken)


def _received(services: Services, world: World, box: Box[Notice | None], label: str) -> Step[World]:
    memory, notice = world.gateway.value, box.value
    assert notice is not None
    acted = services.boxes.once(("receive", world.gateway, box), lambda: services.gateway.receive(memory, notice))
    return services.after_gateway(world._replace(notice=services.boxes(None)), acted, label, helps=True)


def _is_recorded_inside(world: World) -> bool:
    return bool(world.gateway.value.case.progress.inside)


def _case_heard(services: Services, world: World) -> Step[World]:
    robot, plant, inside = up(world), world.plant.value, _is_recorded_inside(world)
    ran = services.boxes.once(
        ("case", inside, world.robot, world.plant), lambda: services.robot.hear_case(robot, plant, inside=inside)
    )
    return services.after_robot(world, ran, "the robot hears of the case", helps=True)


def _thief(services: Services, world: World) -> Iterator[Step[World]]:
    """Another client takes permits from what it hears and puts them into commands of its own; one at a time."""
    if any(one.packet.client == THIEF for one in world.network.value):
        return
    slot = free_slot(world.gateway.value, world.network.value)
    heard = {permit for one in world.network.value for permit in one.packet.permits}
    forged = Permission(f"permit-{slot}", "reference", PlanName.NONE, THIS_BOOT, Quote.NEW, True, genuine=False)
    plans = {permit.motion: permit.plan for permit in heard}
    for permit in sorted(heard | {forged}):
        packet = Packet(
            slot, permit.motion, THIEF, 1, THIS_BOOT, Quote.NEW, plans.get(permit.motion, PlanName.NONE), (permit,)
        )
        for after, lost in _with(services, world, packet):
            kind = "a stolen" if permit.genuine else "a forged"
            yield Step(f"another client sends {permit.motion} with {kind} permit{lost}", services.tidied(after))
