"""The gateway's handlers as they are, with their memory put in before each event and taken out after it."""

import itertools
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import replace
from typing import NoReturn, ParamSpec, TypeVar, cast

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import (
    CaseOpened,
    CaseSetup,
    ImageReceived,
    LocalisationReceived,
    PartUse,
    PlanMade,
    Step,
)
from services.ui_api.core.events import EventDraft
from services.ui_api.core.identity import Approver, Authenticated
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.procedure_table import Action, Verdict, decide
from services.ui_api.handlers.cases import CaseHandler, StepRequest
from services.ui_api.handlers.commands import CommandHandler, PlainVerb, _Waiting
from services.ui_api.handlers.leases import Leases
from services.ui_api.handlers.permits import PermitHandler
from services.ui_api.handlers.planning import MotionRequest, PlanningHandler
from services.ui_api.handlers.procedure import ProcedureHandler
from services.ui_api.handlers.refusals import Refused
from services.ui_api.handlers.robot_view import RobotView, SeenRobot
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.record.unit_of_work import UnitOfWork
from shared.bus.keys import Keys
from shared.errors import NoReply, RecordUnavailable
from shared.messages.base import encode
from shared.messages.robot import CommandReply, MotionState
from shared.runtime.clock import Clock
from tests.model.gateway_memory import Acted, GatewayMemory, Notice, plain_case, plain_operation, state_of
from tests.model.labels import CASE, GATEWAY, NOW_S
from tests.model.memory_record import MemoryRecord
from tests.model.packets import FIRST_NUMBER, Packet, packet, wire
from tests.model.permits import SIGNER
from tests.model.plans import HEXAPOD, HOLES, IMAGE_SHA256, REGISTRATION_EPOCH, PlanName, sha256
from tests.model.robot_memory import Reply
from tests.model.silent_bus import SilentBus

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
KEYS = Keys("or1")
WHO = "surgeon"
APPROVER = Approver(WHO, Authenticated.PASSWORD)
STALE_AFTER_S = 1.0


class _AskedRobot(BaseException):
    """The gateway has put its question to the robot, and waits."""


class _ByHand(Executor):
    """The sender's thread: the model is it."""

    def __init__(self) -> None:
        self.waiting: list[_Waiting] = []

    def submit(self, fn: Callable[_Given, _Result], /, *args: _Given.args, **kwargs: _Given.kwargs) -> Future[_Result]:  # noqa: ARG002
        """Keep a command until the model sends it."""
        assert not kwargs
        self.waiting.extend(cast("tuple[_Waiting, ...]", args))
        handed_over: Future[_Result] = Future()
        handed_over.cancel()  # the model sends what waits itself, and never calls `fn`
        return handed_over


class GatewaySide:
    """One gateway for all states of the model."""

    def __init__(self) -> None:
        self._bus = SilentBus()
        self._record = MemoryRecord()
        clock = Clock(lambda: 0, lambda: NOW_S)
        self._view = RobotView(clock, STALE_AFTER_S)
        self._stops = StopHandler(self._bus, KEYS, GATEWAY)
        permits = PermitHandler(self._record, SIGNER)
        leases = Leases(clock, 1.0, lambda _: None)
        self._sender = _ByHand()
        self._commands = CommandHandler(
            self._bus, KEYS, self._record, self._view, self._stops, leases, clock, permits, sender=self._sender
        )
        self._procedure = ProcedureHandler(self._record, self._view)
        self._cases = CaseHandler(self._record, lambda: None, lambda: None, lambda _: True, self._procedure)
        self._planning = PlanningHandler(self._bus, KEYS, self._record, self._procedure, self._commands)
        self._commands._client = GATEWAY

    def started(self) -> GatewayMemory:
        """The gateway with a case that was opened and for which a plan was approved."""
        part = PartUse("part", "0" * 64, HOLES)
        hexapod = replace(part, sha256=HEXAPOD.sha256)
        setup = CaseSetup("left", "femur", "distal", 60.0, part, part, part, hexapod)
        self._record.ledger = Ledger()
        self._record.note([EventDraft(CaseOpened(setup), CASE, WHO), *_PLANNED])
        case = self._record.ledger.cases[CASE]
        with self._record.write() as unit:
            self._planning.approve(unit, case, 1, APPROVER)
        return GatewayMemory(True, plain_case(self._record.ledger.cases[CASE]), ())

    def begin_move(self, memory: GatewayMemory, slot: str, number: int, *, is_full: bool = False) -> Acted | None:
        """Somebody asks for the motion of the approved plan."""

        def act(unit: UnitOfWork) -> None:
            self._planning.begin_motion(
                unit, self._case(), MotionRequest(1, hold_to_move=False, who=WHO), self._commands.asked()
            )

        return self._write(memory, act, slot, number, is_full=is_full)

    def begin_plain(
        self, memory: GatewayMemory, verb: PlainVerb, slot: str, number: int, *, is_full: bool = False
    ) -> Acted | None:
        """Somebody asks for a command without a plan."""

        def act(unit: UnitOfWork) -> None:
            self._commands.begin_plain(unit, verb, APPROVER, self._commands.asked())

        return self._write(memory, act, slot, number, is_full=is_full)

    def record_step(self, memory: GatewayMemory, step: Step) -> Acted | None:
        """Somebody reports what hands did, with a reason if it is out of order."""

        def act(unit: UnitOfWork) -> None:
            self._cases.record_step(unit, CASE, StepRequest(step, (), WHO, "it was done"))

        return self._write(memory, act, "", 0)

    def plan_anew(self, memory: GatewayMemory) -> Acted | None:
        """An image is taken and localised, a plan made and approved."""
        case = replace(memory.case, images=(), localisations=(), localised_at_ns=(), plans=())

        def act(unit: UnitOfWork) -> None:
            self._planning.approve(unit, self._case(), 1, APPROVER)

        self._load(replace(memory, case=case))
        self._record.note(_PLANNED[:2])
        if decide(self._procedure.situation(self._case()), Action.REQUEST_PLAN).verdict is not Verdict.ALLOWED:
            return None
        self._record.note(_PLANNED[2:])
        return self._act(memory, act, "")

    def stop(self, memory: GatewayMemory) -> Acted:
        """Somebody asks for a stop: no command that waits is sent any more."""
        return Acted(replace(memory, queue=tuple((waiting, True) for waiting, _ in memory.queue)))

    def send(self, memory: GatewayMemory) -> Acted:
        """The sender's thread takes the first command that waits."""
        waiting, _ = memory.queue[0]
        self._load(memory)
        first = self._sender.waiting.pop(0)
        self._bus.replies = _ask
        after = replace(memory, queue=memory.queue[1:])
        try:
            self._commands._send(first)
        except KeyError:
            return self._save(after, "")
        except _AskedRobot:
            return Acted(replace(after, sending=(waiting.slot, waiting.verb)), sent=waiting)
        return self._save(after, "")

    def answered(self, memory: GatewayMemory, reply: Reply | None) -> Acted:
        """The robot's answer comes, or none within the time."""
        assert memory.sending is not None
        slot, verb = memory.sending
        self._load(memory)
        self._bus.replies = lambda *_: _answer(slot, reply)
        with suppress(KeyError):  # of what is not on record nothing can be noted: the sender's thread fails
            self._commands._note(self._commands._ask_robot(_Waiting(slot, verb, b"", _STOPS)))
        return self._save(replace(memory, sending=None), "")

    def receive(self, memory: GatewayMemory, notice: Notice) -> Acted:
        """A state of the robot comes."""
        self._load(memory)
        state = state_of(notice, later=True)
        self._view.note(state)
        self._commands.follow(state)
        return self._save(replace(memory, seen=notice.as_seen()), "")

    def restarted(self, memory: GatewayMemory) -> Acted:
        """The gateway starts again with what its record holds."""
        memory = GatewayMemory(True, memory.case, memory.operations)
        self._load(memory)
        self._commands.adopt_orphans()
        return self._save(memory, "")

    def _case(self) -> Case:
        return self._record.ledger.cases[CASE]

    def _write(
        self, memory: GatewayMemory, act: Callable[[UnitOfWork], None], slot: str, number: int, *, is_full: bool = False
    ) -> Acted | None:
        self._load(memory)
        self._commands._client_sequence = itertools.count(FIRST_NUMBER + number)
        self._record.database.is_full = is_full
        return self._act(memory, act, slot)

    def _act(self, memory: GatewayMemory, act: Callable[[UnitOfWork], None], slot: str) -> Acted | None:
        try:
            with self._record.write() as unit:
                act(unit)
        except (Refused, RecordUnavailable):
            if len(self._sender.waiting) == len(memory.queue):
                return None
        return self._save(memory, slot)

    def _load(self, memory: GatewayMemory) -> None:
        operations = {o.requested.operation_id: o for o in memory.operations}
        self._record.load(Ledger(None, {CASE: memory.case}, operations))
        state = None if memory.seen is None else state_of(memory.seen, later=False)
        self._view._seen = None if state is None else SeenRobot(state, NOW_S)
        self._stops.count = _STOPS
        self._sender.waiting = [
            _Waiting(waiting.slot, waiting.verb, wire(waiting), _STOPS - int(was_stopped))
            for waiting, was_stopped in memory.queue
        ]

    def _save(self, before: GatewayMemory, slot: str) -> Acted:
        known = {o.requested.operation_id: o.ended for o in before.operations}
        operations = self._record.ledger.operations.values()
        new = [
            w for w in self._sender.waiting if w.operation_id not in {p.slot for p, _ in before.queue} | known.keys()
        ]
        names = {w.operation_id: slot for w in new}
        queue = before.queue + tuple((_packet(w, slot), False) for w in new)
        after = replace(before, operations=tuple(plain_operation(o, names) for o in operations), queue=queue)
        ended = tuple(
            (o.requested.operation_id, bool(o.began))
            for o in operations
            if o.ended and not known.get(o.requested.operation_id)
        )
        after = after.without_ended()
        return Acted(replace(after, case=plain_case(self._case(), names, after.pending)), None, ended)


_STOPS = 7
_PLANNED = (
    EventDraft(ImageReceived(IMAGE_SHA256, "1.2.3", 0, 1, None), CASE, "imaging"),
    EventDraft(
        LocalisationReceived(1, IMAGE_SHA256, 1, REGISTRATION_EPOCH, "accepted", (), "", None), CASE, "registration"
    ),
    EventDraft(PlanMade(1, 1, HOLES, sha256(PlanName.CURRENT), IMAGE_SHA256, 1), CASE, "registration"),
)


def _packet(waiting: _Waiting, slot: str) -> Packet:
    return packet(waiting.verb, waiting.payload, slot)


def _ask(key: str, payload: bytes) -> NoReturn:
    raise _AskedRobot


def _answer(slot: str, reply: Reply | None) -> bytes:
    if reply is None:
        raise NoReply("no answer")
    return encode(CommandReply(command_id=slot, verdict=reply.verdict, code=reply.code, state=MotionState.LOCKED))
