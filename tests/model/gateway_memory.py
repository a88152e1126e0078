"""What the gateway remembers between two events, as far as it decides anything."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

from services.ui_api.core.case import Case
from services.ui_api.core.guide_moved import UNSEEN
from services.ui_api.core.operations import Operation
from services.ui_api.core.procedure import Aim, Stage
from services.ui_api.core.robot_event_data import CommandVerb
from shared.messages.robot import MotionState, RobotState, StopLatch
from tests.model.labels import EARLIER_BOOT, NOW_S, PERIOD_S, Quote, quote_of
from tests.model.packets import Packet
from tests.model.plans import HEXAPOD, PlanName, sha256


@dataclass(frozen=True, slots=True)
class Notice:
    """A state of the robot on its way to the gateway, or as the gateway saw it last."""

    boot: str
    quote: Quote
    state: MotionState
    stop: StopLatch
    command_id: str | None
    outcome: str

    def aged(self, change: Callable[[Quote], Quote]) -> "Notice":
        """After time has passed, or a stop has come; see `Packet.aged`."""
        return self if self.boot == EARLIER_BOOT else replace(self, quote=change(self.quote))

    def as_seen(self) -> "Notice":
        """What of it decides anything once it was received."""
        is_ready = self.state is MotionState.LOCKED
        if is_ready:
            return replace(self, outcome="none")
        return replace(self, state=MotionState.STOPPED, stop=StopLatch.LATCHED, outcome="none")

    @staticmethod
    def of(state: RobotState) -> "Notice":
        """What of a published state decides anything at the gateway."""
        quote = quote_of(state.sequence)
        return Notice(state.boot_epoch, quote, state.state, state.stop, state.command_id, state.outcome)


@dataclass(frozen=True, slots=True)
class GatewayMemory:
    """All that the gateway remembers and that may decide anything later.

    Attributes
    ----------
    is_up
        Whether it runs: otherwise only the record is left.
    case, operations
        From the record: the open case, and operations that have not ended, or that are still to be sent or answered.
    seen
        The robot as last seen; None when that is too long ago to be relied on.
    queue
        Commands that wait to be sent, and whether a stop has come since each was asked for.
    sending
        Operation whose answer is waited for.
    """

    is_up: bool
    case: Case
    operations: tuple[Operation, ...]
    seen: Notice | None = None
    queue: tuple[tuple[Packet, bool], ...] = ()
    sending: tuple[str, CommandVerb] | None = None

    @property
    def pending(self) -> tuple[Operation, ...]:
        """Operations that have not ended."""
        return tuple(o for o in self.operations if not o.ended)

    def without_ended(self) -> "GatewayMemory":
        """Without operations of which nothing more can be recorded."""
        named = {packet.slot for packet, _ in self.queue} | {self.sending[0] if self.sending else ""}
        kept = (o for o in self.operations if not o.ended or o.requested.operation_id in named)
        return replace(self, operations=tuple(kept))


@dataclass(frozen=True, slots=True)
class Acted:
    """What came of an event: None for a memory that was left as it was, because the gateway refused."""

    memory: GatewayMemory
    sent: Packet | None = None
    ended: tuple[tuple[str, bool], ...] = ()


def with_plan(memory: GatewayMemory, name: PlanName) -> GatewayMemory:
    """The same, when the current plan has become another in relation to the present."""
    plan = sha256(name)
    entries = tuple(
        replace(
            e, made=replace(e.made, plan_sha256=plan), approval=e.approval and replace(e.approval, plan_sha256=plan)
        )
        for e in memory.case.plans
    )
    return replace(memory, case=replace(memory.case, plans=entries))


def with_quotes(memory: GatewayMemory, change: Callable[[Quote], Quote]) -> GatewayMemory:
    """The same, when quoted states have become older."""

    def aged(operation: Operation) -> Operation:
        return with_quote(operation, change(quote_of(operation.requested.after_state_sequence)))

    seen = memory.seen and memory.seen.aged(change)
    queue = tuple((waiting.aged(change), stopped) for waiting, stopped in memory.queue)
    return replace(memory, operations=tuple(aged(o) for o in memory.operations), seen=seen, queue=queue)


def after_robot_restart(memory: GatewayMemory) -> GatewayMemory:
    """The same, when the robot service has begun another run."""
    operations = tuple(
        replace(o, requested=replace(o.requested, robot_boot_epoch=EARLIER_BOOT)) for o in memory.operations
    )
    seen = memory.seen and replace(memory.seen, boot=EARLIER_BOOT, quote=Quote.NEW)
    queue = tuple((waiting.after_restart(), stopped) for waiting, stopped in memory.queue)
    return with_plan(replace(memory, operations=operations, seen=seen, queue=queue), PlanName.OF_EARLIER_BOOT)


def with_quote(operation: Operation, quote: Quote) -> Operation:
    """With a quote of which only the age counts at the gateway."""
    aged = {0: Quote.NEW, 1: Quote.OLD, 2: Quote.OLDER}[round((NOW_S - quote.published_s) / PERIOD_S)]
    requested = replace(operation.requested, after_state_sequence=aged.sequence, state_clock_s=aged.published_s)
    return replace(operation, requested=requested)


def plain_operation(operation: Operation, names: dict[str, str]) -> Operation:
    """Under the model's names, and without what no decision of the model rests on."""
    requested = operation.requested
    name = names.get(requested.operation_id, requested.operation_id)
    plain = replace(
        operation,
        requested=replace(
            requested,
            operation_id=name,
            plan_sha256=None,
            permit_sha256=None,
            permit_signature=None,
            permit_key_sha256=None,
        ),
        code="",
        message="",
        requested_at_ns=0,
        ended_at_ns=None,
    )
    return with_quote(plain, quote_of(requested.after_state_sequence))


def plain_case(case: Case, names: dict[str, str] | None = None, pending: tuple[Operation, ...] = ()) -> Case:
    """Without what no decision of the model rests on."""
    motions = tuple((names or {}).get(m, m) for m in case.motions[-1:])
    waits = {o.requested.operation_id for o in pending}
    moving = case.progress.stage is Stage.MOVING
    return replace(
        case,
        changed_at_ns=0,
        progress=replace(case.progress, seen=False, aim=Aim.NONE),
        motions=tuple(m for m in motions if m in waits),
        stage_before_motion=case.stage_before_motion if moving else Stage.POSITIONING,
        step_entries=(),
        steps_recorded=0,
        # Every image of the model is of now: it lets more motions pass than the gateway does.
        guide_moved=None,
        guide_moved_before_motion=None,
        reference_id=None,
        robot=UNSEEN,
    )


@cache
def state_of(notice: Notice, *, later: bool) -> RobotState:
    """A robot state that stands for a notice; one that comes now is newer than all that were seen."""
    return RobotState(
        boot_epoch=notice.boot,
        sequence=notice.quote.sequence + int(later),
        sent_at_ns=0,
        clock_s=notice.quote.published_s,
        state=notice.state,
        stop=notice.stop,
        locked=True,
        referenced=True,
        pose=None,
        leg_lengths_mm=None,
        pivot_mm=(0.0, 0.0, 0.0),
        hexapod_sha256=HEXAPOD.sha256,
        command_id=notice.command_id,
        outcome=notice.outcome,
    )
