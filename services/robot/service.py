"""The robot on the bus: messages in, drive and guard, messages out."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Self

from services.robot import message_mapping
from services.robot.core.envelope import CommandLedger, Envelope, Repeat
from services.robot.core.guard import PermittedMove, check_move, check_supervision
from services.robot.core.guard_context import GuardContext, GuardLimits
from services.robot.core.permits import AskedMotion, Motion
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.status import UNDER_WAY, DriveStatus
from services.robot.core.tuning import RATES
from services.robot.drive.drive import Drive
from services.robot.gateway_monitor import GatewayMonitor
from services.robot.other_services import OtherServices
from services.robot.permit_register import NotePermit, PermitRegister
from services.robot.registration_monitor import RegistrationMonitor
from shared.bus.keys import Keys
from shared.bus.port import Answer, Bus, Query
from shared.errors import InputError
from shared.geometry.hexapod import HexapodPart
from shared.messages.base import decode, encode
from shared.messages.robot import CommandReply, PlainCommand, StopCommand
from shared.pki.permit_key import PermitVerifier
from shared.threads import supervised_thread

_log = logging.getLogger("distalock.robot")


@dataclass(frozen=True, slots=True, eq=False)
class RobotParts:
    """What the service is made of.

    Attributes
    ----------
    clock_s
        Monotonic clock.
    note_change
        Called after the state or its explanation has changed: for logs and health.
    permit_verifier
        Knows the gateway's signature.
    note_permit
        Called with each permit that was taken or refused: for logs.
    silent_for_s
        Who else is missed in motion, beside the services on the bus: how long each has been silent.
    """

    hexapod: HexapodPart
    limits: GuardLimits
    drive: Drive
    boot_epoch: str
    clock_s: Callable[[], float]
    note_change: Callable[[DriveStatus], None]
    permit_verifier: PermitVerifier
    note_permit: NotePermit
    silent_for_s: dict[str, Callable[[], float]] = field(default_factory=dict)


class RobotService:
    """Answers commands, publishes the state, and listens to registration, the open case and the gateway.

    Use as a context manager: entering connects to the controller, leaving stops and locks the robot.
    """

    def __init__(self, bus: Bus, keys: Keys, parts: RobotParts) -> None:
        self._bus = bus
        self._keys = keys
        self._parts = parts
        self._drive = parts.drive
        others = OtherServices(bus, keys, parts.drive, parts.clock_s, parts.silent_for_s)
        deadline_s = parts.limits.heartbeat_deadline_s
        self.watch = GatewayMonitor(bus, keys, parts.drive, deadline_s, parts.clock_s, others)
        self._lock = threading.Lock()
        self._ledger = CommandLedger(parts.boot_epoch)
        self._permits = PermitRegister(
            parts.permit_verifier, self._ledger, parts.clock_s, parts.note_permit, parts.hexapod.sha256
        )
        self._registration = RegistrationMonitor(parts.drive, self._lock, parts.clock_s)
        # Far more than fit into the lifetime of a plan.
        self._executed: deque[str] = deque(maxlen=1024)
        self._sequence = 0
        self._publisher = bus.retained_publisher(keys.robot_state)
        self._ended = threading.Event()
        self._publishing = supervised_thread("robot-state", self._publish_forever)

    def __enter__(self) -> Self:
        self.listen()
        self._drive.start()
        self.watch.start()
        self._publishing.start()
        self.answer()
        return self

    def listen(self) -> None:
        """Subscribe to registration, the gateway and the open case."""
        self._registration.listen(self._bus, self._keys)

    def answer(self) -> None:
        """Begin to answer commands."""
        bus, keys = self._bus, self._keys
        bus.queryable(keys.robot_command("stop"), self._on_stop)
        bus.queryable(keys.robot_command("move"), self._on_move)
        bus.queryable(keys.robot_command("reference"), self._on_reference)
        bus.queryable(keys.robot_command("acknowledge_stop"), self._on_acknowledge_stop)
        bus.queryable(keys.robot_command("reset"), self._on_reset)

    def __exit__(self, *_: object) -> None:
        self._drive.close()
        self.watch.close()
        self._ended.set()
        self._publishing.join()
        self.publish(self._drive.status)

    def _on_stop(self, query: Query) -> Future[Answer]:
        # Stopped before it is understood: a stop that cannot be read is a stop all the same.
        self._drive.halt()
        try:
            stop = decode(StopCommand, query.payload)
        except InputError:
            stop = StopCommand(client="unknown")
        reason = f": {stop.reason}" if stop.reason else ""
        sent = self._drive.stop(f"'{stop.client}' asked for a stop{reason}")
        answer: Future[Answer] = Future()
        self._drive.when_confirmed(
            sent, lambda result, state: answer.set_result(Answer(encode(message_mapping.stopped(result, state))))
        )
        return answer

    def _on_move(self, query: Query) -> Answer:
        try:
            request = message_mapping.move_request(query.payload)
        except InputError as error:
            return self._not_understood(error)
        return self._once(request.envelope, lambda: self._begin_move(request))

    def _on_reference(self, query: Query) -> Answer:
        return self._on_plain(query, "reference", self._begin_reference)

    def _on_acknowledge_stop(self, query: Query) -> Answer:
        return self._on_plain(query, "acknowledge_stop", lambda _: self._drive.acknowledge_stop())

    def _on_reset(self, query: Query) -> Answer:
        return self._on_plain(query, "reset", lambda _: self._drive.reset())

    def _on_plain(self, query: Query, verb: str, carry_out: Callable[[PlainCommand], Refusal | None]) -> Answer:
        try:
            command = decode(PlainCommand, query.payload)
        except InputError as error:
            return self._not_understood(error)
        if command.verb != verb:
            return self._not_understood(InputError(f"a command '{command.verb}' was sent to the key of '{verb}'"))
        envelope = message_mapping.envelope(command.envelope, verb)
        return self._once(envelope, lambda: carry_out(command))

    def _once(self, envelope: Envelope, carry_out: Callable[[], Refusal | None]) -> Answer:
        """Carry a command out at most once, never late, and answer its repeats from the record."""
        with self._lock, self._drive.deciding() as status:
            admission = self._ledger.admit(envelope, self._parts.clock_s(), status.stops)
            if isinstance(admission, Repeat):
                return Answer(admission.answer)
            if isinstance(admission, Refusal):
                return Answer(encode(self._refused(envelope.command_id, admission)))
            refusal = carry_out()
            reply = (
                message_mapping.accepted(envelope.command_id, self._drive.status.state)
                if refusal is None
                else self._refused(envelope.command_id, refusal)
            )
            self._ledger.answered(envelope.command_id, encode(reply))
            if refusal is None:
                _log.info("command accepted: %s (command %s)", envelope.effect, envelope.command_id)
            return Answer(encode(reply))

    def _begin_move(self, request: message_mapping.MoveRequest) -> Refusal | None:
        def guard(status: DriveStatus) -> PermittedMove | Refusal:
            permitted = check_move(request.plan_sha256, self._guard_context(status))
            if isinstance(permitted, PermittedMove):
                # On record before anything moves.
                self._executed.append(permitted.plan_sha256)
            return permitted

        heard = self._registration.view.heard_plan(request.plan_sha256)
        asked = AskedMotion(Motion.MOVE, request.plan_sha256, None if heard is None else heard.plan.hole_ids)
        without_permit = self._permits.take(request.permit, asked, self._registration.view)
        return without_permit or self._drive.begin_move(request.envelope.command_id, guard)

    def _begin_reference(self, command: PlainCommand) -> Refusal | None:
        asked = AskedMotion(Motion.REFERENCE)
        without_permit = self._permits.take(command.permit, asked, self._registration.view)
        unwatched = without_permit or check_supervision(self._guard_context(self._drive.status))
        return unwatched or self._drive.begin_reference(command.envelope.command_id)

    def _guard_context(self, status: DriveStatus) -> GuardContext:
        now_s = self._parts.clock_s()
        return GuardContext(
            boot_epoch=self._parts.boot_epoch,
            now_s=now_s,
            hexapod=self._parts.hexapod,
            limits=self._parts.limits,
            registration=self._registration.view,
            feedback=status.fresh_feedback(now_s),
            connected_s=status.connected_s,
            heartbeat_s=self.watch.heartbeat_s(),
            link_up=self.watch.link_up(),
            executed=frozenset(self._executed),
            stop_button=status.stop_button,
        )

    def _not_understood(self, error: InputError) -> Answer:
        refusal = Refusal(RefusalCode.MESSAGE_INVALID, f"the command was not understood: {error}")
        return Answer(encode(self._refused(None, refusal)))

    def _refused(self, command_id: str | None, refusal: Refusal) -> CommandReply:
        _log.warning("command refused: %s: %s (command %s)", refusal.code, refusal.message, command_id)
        return message_mapping.refused(command_id, refusal, self._drive.status.state)

    def _publish_forever(self) -> None:
        noted: DriveStatus | None = None
        while not self._ended.is_set():
            status = self._drive.status
            self.publish(status)
            if noted is None or (status.state, status.detail) != (noted.state, noted.detail):
                self._parts.note_change(status)
                noted = status
            pause_s = RATES.publish_moving_s if status.state in UNDER_WAY else RATES.publish_at_rest_s
            self._drive.wait_for_change(status, pause_s)

    def publish(self, status: DriveStatus) -> None:
        """Publish a status: what the publishing thread does over and over, for it or for a test in its place."""
        with self._lock:
            self._sequence += 1
            self._ledger.note_published(self._sequence, self._parts.clock_s(), status.stops)
            published = message_mapping.Publication(
                self._parts.boot_epoch, self._sequence, self._registration.view.epoch, self._permits.record
            )
        state = message_mapping.robot_state(status, self._parts.hexapod, published)
        self._publisher.put(encode(state))
