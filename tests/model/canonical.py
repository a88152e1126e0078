"""One world in place of many that differ in names alone, or in what nothing can ask for any more."""

from dataclasses import replace

from services.robot.core.status import DriveStatus
from services.ui_api.core.case import Case
from services.ui_api.core.operations import Operation
from services.ui_api.core.procedure import Stage
from tests.model.gateway_memory import GatewayMemory, Notice
from tests.model.labels import GATEWAY, SLOTS
from tests.model.packets import Packet
from tests.model.robot_memory import RobotMemory
from tests.model.world import OnItsWay

Parts = tuple[RobotMemory | None, GatewayMemory, tuple[OnItsWay, ...], Notice | None]
# An identifier of which nothing more is to be known than that it is no other.
FORGOTTEN = "z"


def tidied(
    robot: RobotMemory | None, gateway: GatewayMemory, network: tuple[OnItsWay, ...], notice: Notice | None
) -> Parts:
    """The same with names, clients and counts given anew, and without what no message can ask for."""
    gateway = replace(gateway.without_ended(), case=_plain_case(gateway.case))
    packets = [one.packet for one in network] + [packet for packet, _ in gateway.queue]
    clients = _client_names(packets)
    newest = {} if robot is None else dict(robot.newest)
    ranks = {client: sorted({p.number for p in packets if p.client == client}) for client in clients}
    slots = _slot_names(gateway, packets)

    nonces = _nonce_names(packets, slots)

    def renamed(packet: Packet) -> Packet:
        number = ranks[packet.client].index(packet.number) + 1
        permits = tuple(replace(permit, nonce=nonces[permit.nonce]) for permit in packet.permits)
        return replace(packet, slot=slots[packet.slot], client=clients[packet.client], number=number, permits=permits)

    if robot is not None:
        overtaken = ((clients[c], sum(n <= newest.get(c, 0) for n in numbers)) for c, numbers in ranks.items())
        asked = {packet.slot for packet in packets}
        robot = replace(
            robot,
            status=_plain_status(robot, slots, {o.requested.operation_id for o in gateway.operations}),
            newest=tuple(sorted((client, count) for client, count in overtaken if count)),
            used=tuple(sorted((nonces[nonce], is_old) for nonce, is_old in robot.used if nonce in nonces)),
            answers=tuple(sorted((slots[a[0]], *a[1:]) for a in robot.answers if a[0] in asked)),
        )
    gateway = _renamed_gateway(gateway, slots)
    gateway = replace(gateway, queue=tuple((renamed(packet), stopped) for packet, stopped in gateway.queue))
    network = tuple(sorted(replace(one, packet=renamed(one.packet)) for one in network))
    return robot, gateway, network, _renamed_notice(notice, slots)


def _slot_names(gateway: GatewayMemory, packets: list[Packet]) -> dict[str, str]:
    """Operations first, then commands on their way."""
    named = [o.requested.operation_id for o in gateway.operations]
    named += [packet.slot for packet in sorted(packets, key=lambda p: (p.verb, p.client, p.number, p.boot, p.quote))]
    return {slot: SLOTS[place] for place, slot in enumerate(dict.fromkeys(named))}


def _nonce_names(packets: list[Packet], slots: dict[str, str]) -> dict[str, str]:
    """In the order of the commands that carry them."""
    carried = sorted((slots[packet.slot], permit.nonce) for packet in packets for permit in packet.permits)
    return {nonce: f"permit-{SLOTS[place]}" for place, nonce in enumerate(dict.fromkeys(n for _, n in carried))}


def _plain_status(robot: RobotMemory, slots: dict[str, str], operations: set[str]) -> DriveStatus:
    status = robot.status
    matters = status.outcome == "moving" or status.command_id in operations
    name = status.command_id and slots.get(status.command_id, FORGOTTEN)
    return replace(status, command_id=name, outcome=status.outcome if matters else "none")


def _renamed_gateway(gateway: GatewayMemory, slots: dict[str, str]) -> GatewayMemory:
    def renamed(operation: Operation) -> Operation:
        requested = operation.requested
        previous = requested.previous_command_id
        requested = replace(
            requested,
            operation_id=slots[requested.operation_id],
            previous_command_id=previous and slots.get(previous, FORGOTTEN),
        )
        return replace(operation, requested=requested)

    case = replace(gateway.case, motions=tuple(slots[m] for m in gateway.case.motions if m in slots))
    return replace(
        gateway,
        case=case,
        operations=tuple(renamed(o) for o in gateway.operations),
        seen=_renamed_notice(gateway.seen, slots),
        sending=gateway.sending and (slots[gateway.sending[0]], gateway.sending[1]),
    )


def _renamed_notice(notice: Notice | None, slots: dict[str, str]) -> Notice | None:
    if notice is None or notice.command_id is None:
        return notice
    return replace(notice, command_id=slots.get(notice.command_id, FORGOTTEN))


def _plain_case(case: Case) -> Case:
    """A case that was aligned is planned for and moved as one that is being positioned."""
    if case.progress.stage is not Stage.ALIGNED:
        return case
    return replace(case, progress=replace(case.progress, stage=Stage.POSITIONING))


def _client_names(packets: list[Packet]) -> dict[str, str]:
    """Earlier runs of the gateway are counted from the newest."""
    earlier = sorted({p.client for p in packets if p.client.startswith("gateway-") and p.client != GATEWAY})
    names = {client: f"gateway-{age}" for age, client in enumerate(earlier, start=1)}
    return {p.client: names.get(p.client, p.client) for p in packets}


def after_gateway_restart(packet: Packet) -> Packet:
    """The command of a run of the gateway that has ended."""
    if packet.client == GATEWAY:
        return replace(packet, client="gateway-0")
    return packet


def next_number(gateway: GatewayMemory, network: tuple[OnItsWay, ...]) -> int:
    """The number that the gateway gives its next command."""
    packets = [one.packet for one in network] + [packet for packet, _ in gateway.queue]
    return 1 + sum(packet.client == GATEWAY for packet in packets)


def free_slot(gateway: GatewayMemory, network: tuple[OnItsWay, ...]) -> str:
    """An identifier that nothing names."""
    named = {o.requested.operation_id for o in gateway.operations} | {one.packet.slot for one in network}
    named |= {packet.slot for packet, _ in gateway.queue}
    nonces = {permit.nonce for one in network for permit in one.packet.permits}
    return next(slot for slot in SLOTS if slot not in named and f"permit-{slot}" not in nonces)
