"""Commands on the network: what of each decides anything, and the bytes that stand for it while code runs."""

from dataclasses import dataclass, replace
from functools import cache

from services.ui_api.core.robot_event_data import CommandVerb
from shared.messages.base import decode, encode
from shared.messages.robot import CommandEnvelope, MoveCommand, PlainCommand
from tests.model.labels import EARLIER_BOOT, THIS_BOOT, Quote, QuoteChange, quote_of
from tests.model.permits import Permission, permission
from tests.model.plans import PlanName, plan_of, sha256

TIME_TO_LIVE_S = 1.0
# Numbers of commands count from here: below lie those that came before anything that is on its way.
FIRST_NUMBER = 10


@dataclass(frozen=True, slots=True, order=True)
class Packet:
    """A command that was sent: it may arrive now, later, twice, or never.

    Attributes
    ----------
    slot
        Its identifier.
    client, number
        Who sent it, and as which of the client's commands that are still on their way.
    boot, quote
        Run of the robot service that it is for, and the robot state that its client had seen.
    permits
        The permit that it carries, or none.
    """

    slot: str
    verb: CommandVerb
    client: str
    number: int
    boot: str
    quote: Quote
    plan: PlanName = PlanName.NONE
    permits: tuple[Permission, ...] = ()

    def aged(self, change: QuoteChange) -> "Packet":
        """After time has passed, or a stop has come.

        What it quotes of an earlier run of the robot service may be any number that this run has published.
        """
        permits = tuple(permit.aged(change) for permit in self.permits)
        quote = self.quote if self.boot == EARLIER_BOOT else change(self.quote)
        return replace(self, quote=quote, permits=permits)

    def after_restart(self) -> "Packet":
        """After the robot service was started again."""
        permits = tuple(permit.after_restart() for permit in self.permits)
        return replace(self, boot=EARLIER_BOOT, quote=Quote.NEW, plan=self.plan.after_restart(), permits=permits)

    def after_new_plan(self) -> "Packet":
        """After another plan was made."""
        if self.plan is PlanName.NONE:
            return self
        return replace(self, plan=PlanName.STALE, permits=tuple(replace(p, plan=PlanName.STALE) for p in self.permits))


@cache
def wire(packet: Packet) -> bytes:
    """The command as it travels."""
    envelope = CommandEnvelope(
        command_id=packet.slot,
        client=packet.client,
        client_sequence=FIRST_NUMBER + packet.number,
        robot_boot_epoch=packet.boot,
        after_state_sequence=packet.quote.sequence,
        time_to_live_s=TIME_TO_LIVE_S,
        issued_at_ns=0,
    )
    permit = packet.permits[0].signed() if packet.permits else None
    if packet.verb != "move":
        return encode(PlainCommand(verb=packet.verb, envelope=envelope, permit=permit))
    assert permit is not None
    return encode(MoveCommand(envelope=envelope, plan_sha256=sha256(packet.plan), permit=permit))


def packet(verb: CommandVerb, payload: bytes, slot: str) -> Packet:
    """What a payload of the gateway says, under the model's names."""
    command = decode(MoveCommand, payload) if verb == "move" else decode(PlainCommand, payload)
    envelope, permit = command.envelope, command.permit
    assert envelope.robot_boot_epoch in (THIS_BOOT, EARLIER_BOOT)
    return Packet(
        slot=slot,
        verb=verb,
        client=envelope.client,
        number=envelope.client_sequence - FIRST_NUMBER,
        boot=envelope.robot_boot_epoch,
        quote=quote_of(envelope.after_state_sequence),
        plan=plan_of(command.plan_sha256) if isinstance(command, MoveCommand) else PlanName.NONE,
        permits=() if permit is None else (permission(permit, f"permit-{slot}"),),
    )
