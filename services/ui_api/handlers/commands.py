"""Commands to the robot: recorded before they are sent, sent once, and followed until the robot tells how they end."""

import itertools
import secrets
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import structlog

from services.ui_api.core.events import EventDraft
from services.ui_api.core.identity import Approver
from services.ui_api.core.operations import VERBS_WITH_A_MOTION, Operation, settle
from services.ui_api.core.robot_event_data import (
    CommandVerb,
    OperationEnded,
    OperationProgressed,
    OperationRequested,
    OperationStatus,
)
from services.ui_api.handlers.acting import Acting
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.leases import Leases
from services.ui_api.handlers.operation_requests import Move, requested_operation, with_permit
from services.ui_api.handlers.permits import PermitHandler
from services.ui_api.handlers.refusals import conflict
from services.ui_api.handlers.robot_view import RobotView, SeenRobot, saying_of
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.record.record import CaseRecord
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import BusError, RecordUnavailable
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.robot import (
    CommandEnvelope,
    CommandReply,
    MoveCommand,
    PlainCommand,
    RobotState,
)
from shared.threads import described, supervised
from shared.tracing import carried

_log = structlog.stdlib.get_logger("distalock.ui_api")

# Chosen: the robot answers within milliseconds, and whoever asked for a motion still looks at it.
COMMAND_TIMEOUT_S = 0.5
TIME_TO_LIVE_S = 1.0
# What moves nothing quotes the state of when it was asked for, and may have waited for the record since.
TIME_TO_LIVE_WITHOUT_MOTION_S = 2.0
PlainVerb = Literal["reference", "acknowledge_stop", "reset"]
# A run that refuses a command of an earlier one does not know what that one did: the message may have come twice.
_REFUSED_BY_ANOTHER_RUN = "wrong_boot_epoch"
_VERBS_THAT_END_WITH_THE_REPLY = frozenset({"acknowledge_stop", "reset"})


@dataclass(frozen=True, slots=True)
class Asked:
    """What was known when somebody asked for a command: a request may wait for a thread and for the record.

    Attributes
    ----------
    seen
        The robot as it was seen; None when it had not been heard of.
    stops
        Count of the stops that had been sent.
    """

    seen: SeenRobot | None
    stops: int


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A command on its way to the robot. `stops_before` is the count of stops when it was asked for."""

    operation_id: str
    verb: CommandVerb
    payload: bytes
    stops_before: int


class CommandHandler:
    """Sends commands in the order in which they were recorded, one at a time, never twice.

    Attributes
    ----------
    acting
        Counts commands until the robot has answered.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        record: CaseRecord,
        view: RobotView,
        stops: StopHandler,
        leases: Leases,
        clock: Clock,
        permits: PermitHandler,
        acting: Acting | None = None,
        sender: Executor | None = None,
    ) -> None:
        self.acting = acting or Acting()
        self._permits = permits
        self._bus, self._keys, self._record = bus, keys, record
        self._view, self._stops, self._leases, self._clock = view, stops, leases, clock
        self._client = f"gateway-{secrets.token_hex(6)}"
        self._client_sequence = itertools.count()
        # sends the commands that are on the disk, one after another
        self._sender = sender or ThreadPoolExecutor(max_workers=1, thread_name_prefix="commands")

    def close(self) -> None:
        """Wait for the command that is being sent; those behind it are not sent any more."""
        self._sender.shutdown(wait=True, cancel_futures=True)

    def asked(self) -> Asked:
        """What is known now, for what somebody asks for now."""
        return Asked(self._view.newest(), self._stops.count)

    def begin_move(self, unit: UnitOfWork, case_id: str, who: str, move: Move, asked: Asked) -> Operation:
        """Record a motion, to be sent when the transaction is on the disk; raises `Refused`."""
        self._refuse_while_pending()
        state = self._view.current()
        envelope = self._envelope(state, TIME_TO_LIVE_S)
        permit = self._permits.for_move(unit, state, move.plan)
        command = MoveCommand(envelope=envelope, plan_sha256=move.plan.sha256, permit=permit)
        requested = with_permit(requested_operation(envelope, "move", state, move), permit, move.plan.approver)
        return self._begin(unit, EventDraft(requested, case_id, who), encode(command), asked)

    def begin_plain(self, unit: UnitOfWork, verb: PlainVerb, who: Approver, asked: Asked) -> Operation:
        """Record a command without a plan, to be sent when the transaction is on the disk; raises `Refused`.

        Who acknowledges a stop, or resets a fault, knew of none that came after he had asked: so the command quotes the
        state that was seen then, and the robot refuses it when it has been stopped since.
        """
        state = self._view.current()
        if verb in VERBS_WITH_A_MOTION:
            self._refuse_while_pending()
            envelope = self._envelope(state, TIME_TO_LIVE_S)
        else:
            state = asked.seen.state if asked.seen is not None else state
            envelope = self._envelope(state, TIME_TO_LIVE_WITHOUT_MOTION_S)
        requested, permit = requested_operation(envelope, verb, state, None), None
        if verb in VERBS_WITH_A_MOTION:
            permit = self._permits.for_reference(unit, state, who)
            requested = with_permit(requested, permit, who)
        case = self._record.ledger.open_case()
        draft = EventDraft(requested, case.case_id if case else None, who.name)
        return self._begin(unit, draft, encode(PlainCommand(verb=verb, envelope=envelope, permit=permit)), asked)

    def adopt_orphans(self) -> None:
        """After a restart: commands without a recorded answer are `unknown` until the robot's state settles them."""
        for operation in self._record.ledger.pending_operations():
            if operation.status is OperationStatus.REQUESTED:
                message = "the gateway restarted before an answer was recorded; the robot's state will tell"
                self._note(OperationProgressed(operation.requested.operation_id, OperationStatus.UNKNOWN, message))

    def follow(self, state: RobotState) -> None:
        """Let a robot state settle the operations that have not ended.

        States wait in a queue: one of an earlier run of the robot service says nothing of a command to this one.
        """
        newest = self._view.newest()
        if newest is not None and newest.state.boot_epoch != state.boot_epoch:
            return
        for operation in self._record.ledger.pending_operations():
            verdict = settle(operation, saying_of(state))
            if verdict is not None:
                self._note(verdict)

    def _refuse_while_pending(self) -> None:
        pending = [o for o in self._record.ledger.pending_operations() if o.requested.verb in VERBS_WITH_A_MOTION]
        if pending:
            raise conflict(
                "operation_pending",
                f"operation {pending[0].requested.operation_id} ({pending[0].requested.verb}) is "
                f"{pending[0].status}; wait until it has ended, or stop it",
            )

    def _envelope(self, state: RobotState, time_to_live_s: float) -> CommandEnvelope:
        return CommandEnvelope(
            command_id=secrets.token_hex(16),
            client=self._client,
            client_sequence=next(self._client_sequence),
            robot_boot_epoch=state.boot_epoch,
            after_state_sequence=state.sequence,
            time_to_live_s=time_to_live_s,
            issued_at_ns=self._clock.unix_ns(),
        )

    def _begin(self, unit: UnitOfWork, draft: EventDraft, payload: bytes, asked: Asked) -> Operation:
        requested = draft.data
        assert isinstance(requested, OperationRequested)
        event = unit.append(draft)
        if requested.hold_to_move:
            unit.after_commit(lambda: self._leases.grant(requested.operation_id))
        waiting = _Waiting(requested.operation_id, requested.verb, payload, asked.stops)
        unit.after_commit(lambda: self._hand_over(waiting))
        return Operation(requested, draft.case_id, event.at_ns)

    def _hand_over(self, waiting: _Waiting) -> None:
        self.acting.begin()  # until the robot has answered; the request that asked for it ends before
        sending = self._sender.submit(carried(supervised("commands", self._send)), waiting)
        sending.add_done_callback(lambda _: self.acting.end())

    def _send(self, waiting: _Waiting) -> None:
        """Send a command and record what came of it; whatever goes wrong, the operation does not stay as it was."""
        try:
            self._send_once(waiting)
        except RecordUnavailable as error:
            # The robot's states settle the operation as soon as the record takes entries again.
            _log.error("command_outcome_not_recorded", operation=waiting.operation_id, detail=str(error))
        except Exception as error:
            message = (
                f"the gateway failed while it sent the command ({described(error)}); this does not mean that it was "
                "not carried out: the robot's state will tell"
            )
            with suppress(RecordUnavailable):  # then it is found without an answer by the next start
                self._note(OperationProgressed(waiting.operation_id, OperationStatus.UNKNOWN, message))
            raise

    def _send_once(self, waiting: _Waiting) -> None:
        if self._stops.count != waiting.stops_before or self._leases.has_lapsed(waiting.operation_id):
            message = "stopped before the command was sent; nothing moved"
            self._note(_never_began(waiting, OperationStatus.STOPPED, "stopped_before_sending", message))
            return
        self._note(self._ask_robot(waiting))

    def _ask_robot(self, waiting: _Waiting) -> OperationProgressed | OperationEnded:
        key = self._keys.robot_command(waiting.verb)
        try:
            reply = decode(CommandReply, self._bus.query(key, waiting.payload, COMMAND_TIMEOUT_S).payload)
        except (BusError, MessageInvalid) as error:
            message = f"{error}; this does not mean that it was not carried out: the robot's state will tell"
            return OperationProgressed(waiting.operation_id, OperationStatus.UNKNOWN, message)
        if reply.verdict == "refused" and reply.code == _REFUSED_BY_ANOTHER_RUN:
            message = "the robot service was restarted while the command was on its way; its state will tell"
            return OperationProgressed(waiting.operation_id, OperationStatus.UNKNOWN, message)
        if reply.verdict == "refused":
            return _never_began(waiting, OperationStatus.FAILED, reply.code or "refused_by_robot", reply.message)
        if waiting.verb in _VERBS_THAT_END_WITH_THE_REPLY:
            return OperationEnded(
                waiting.operation_id, OperationStatus.SUCCEEDED, began=True, code="", message=reply.message
            )
        return OperationProgressed(waiting.operation_id, OperationStatus.RUNNING, reply.message)

    def _note(self, data: OperationProgressed | OperationEnded) -> None:
        """Record how an operation fares, unless more is known: reply and robot state may overtake each other."""
        with self._record.write() as unit:
            operation = self._record.ledger.operations[data.operation_id]
            if operation.ended or (isinstance(data, OperationProgressed) and _says_nothing_new(operation, data)):
                return
            unit.append(EventDraft(data, operation.case_id, "robot"))
        if isinstance(data, OperationEnded):
            self._leases.release(data.operation_id)


def _says_nothing_new(operation: Operation, data: OperationProgressed) -> bool:
    return operation.status in (data.status, OperationStatus.RUNNING)


def _never_began(waiting: _Waiting, status: OperationStatus, code: str, message: str) -> OperationEnded:
    return OperationEnded(waiting.operation_id, status, began=False, code=code, message=message)
