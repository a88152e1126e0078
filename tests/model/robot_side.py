"""The robot service as it is, with its memory put in before each event and taken out after it."""

from collections import OrderedDict, deque
from dataclasses import replace

from services.robot.core.envelope import _Record
from services.robot.core.permits import Permit, PermitRecord, UsedPermits
from services.robot.core.plans import EpochReport, HeardPlan, RegistrationView
from services.robot.core.refusals import Refusal
from services.robot.core.status import DriveStatus
from services.robot.core.tuning import SUPERVISION
from services.robot.drive.drive import Drive
from services.robot.service import RobotParts, RobotService
from shared.bus.keys import Keys
from shared.messages.base import decode, encode
from shared.messages.cases import CaseContext, ObjectInside
from shared.messages.presence import Heartbeat
from shared.messages.robot import CommandReply, RobotState, StopCommand
from shared.robot_states import MotionState, StopButton
from tests.model.labels import CASE, GATEWAY, LIMITS, NOW_S, PERIOD_S, THIS_BOOT, UNHEARD_S, Quote
from tests.model.packets import FIRST_NUMBER, Packet, wire
from tests.model.permits import VERIFIER
from tests.model.plans import HEXAPOD, HOLES, REGISTRATION_EPOCH, PlanName, planned, sha256
from tests.model.plant import Plant, PlantController
from tests.model.robot_memory import Ran, Reply, RobotMemory, plain_status
from tests.model.silent_bus import SilentBus

KEYS = Keys("or1")


class RobotSide:
    """One robot service for all states of the model."""

    def __init__(self) -> None:
        self._bus = SilentBus()
        self._plant = PlantController()
        self._taken: list[str] = []
        self._drive = Drive(self._connect, SUPERVISION.read_back, lambda: NOW_S, 1.0, _crashed)
        parts = RobotParts(
            hexapod=HEXAPOD,
            limits=LIMITS,
            drive=self._drive,
            boot_epoch=THIS_BOOT,
            clock_s=lambda: NOW_S,
            note_change=lambda _: None,
            permit_verifier=VERIFIER,
            note_permit=self._note_permit,
        )
        self._service = RobotService(self._bus, KEYS, parts)
        self._service.listen()
        self._service.answer()

    def _connect(self) -> PlantController:
        """As a dialect does: stopped and locked before anything is asked."""
        self._plant.stop_now()
        return self._plant

    def _note_permit(self, outcome: Permit | Refusal, sha256: str) -> None:  # noqa: ARG002 - the service's
        if isinstance(outcome, Permit):
            self._taken.append(outcome.nonce)

    def started(self, plan: PlanName, *, inside: bool) -> RobotMemory:
        """The service right after its start, when it has heard what others keep for those who come late."""
        return RobotMemory(
            DriveStatus(detail="", stop_button=StopButton.ABSENT), (), False, (), (), plan, False, inside, (), None
        )

    def deliver(self, memory: RobotMemory, plant: Plant, packet: Packet) -> Ran:
        """A command arrives."""
        self._load(memory, plant)
        payload = self._bus.answer(KEYS.robot_command(packet.verb), wire(packet))
        return self._save(memory, payload)

    def stop(self, memory: RobotMemory, plant: Plant) -> Ran:
        """A stop arrives."""
        self._load(memory, plant)
        self._stop_now()
        return self._save(memory)

    def _stop_now(self) -> None:
        self._bus.answer(KEYS.robot_command("stop"), encode(StopCommand(client=GATEWAY)))

    def work(self, memory: RobotMemory, plant: Plant) -> Ran:
        """The worker does what is pending, then asks the controller how things are, or connects to it."""
        self._load(memory, plant)
        self._drive.step()
        return self._save(memory)

    def work_while_stopped(self, memory: RobotMemory, plant: Plant) -> Ran:
        """The same, and a stop arrives in the moment before a motion begins."""
        self._load(memory, plant)
        self._plant.before_motion = self._stop_now
        self._drive.step()
        return self._save(memory)

    def fail(self, memory: RobotMemory, plant: Plant) -> Ran:
        """The controller loses power, answers with garbage, and has lost its reference."""
        self._load(memory, replace(plant, referenced=False))
        self._plant.fails = True
        self._drive.step()
        return self._save(memory)

    def hear(self, memory: RobotMemory, plant: Plant) -> Ran:
        """A heartbeat of the gateway arrives."""
        self._load(memory, plant)
        self._bus.publish(KEYS.heartbeat("ui_api"), encode(Heartbeat(service="ui_api", boot_epoch=GATEWAY, sequence=1)))
        return self._save(memory)

    def hear_case(self, memory: RobotMemory, plant: Plant, *, inside: bool) -> Ran:
        """What is in guide and bone arrives from the gateway."""
        self._load(memory, plant)
        objects = (ObjectInside(kind="wire", hole_id=HOLES[0]),) if inside else ()
        self._bus.publish(KEYS.case_context, encode(CaseContext(case_id=CASE, revision=1, inside=objects)))
        return self._save(memory)

    def miss(self, memory: RobotMemory, plant: Plant) -> Ran:
        """No heartbeat has come within the deadline."""
        self._load(memory, plant)
        self._service.watch._watchdog._last_s = NOW_S - UNHEARD_S
        self._service.watch.check()
        return self._save(memory)

    def publish(self, memory: RobotMemory, plant: Plant) -> RobotState:
        """The state that goes out now."""
        self._load(memory, plant)
        self._service.publish(self._drive.status)
        return decode(RobotState, self._bus.put[KEYS.robot_state])

    def _load(self, memory: RobotMemory, plant: Plant) -> None:
        service, motion, watch = self._service, self._drive._motion, self._service.watch
        self._plant.load(plant)
        self._taken.clear()
        motion._status, motion._pending, motion._closing = memory.status, memory.pending, False
        motion._controller = self._plant if memory.connected else None
        ledger = service._ledger
        ledger._records = OrderedDict(
            (slot, _Record(effect, _bytes(slot, reply))) for slot, effect, reply in memory.answers
        )
        ledger._newest_sequence = OrderedDict((client, FIRST_NUMBER + number) for client, number in memory.newest)
        ledger._published = deque((q.sequence, q.published_s) for q in sorted(Quote, reverse=True))
        ledger._published_stops, ledger._first_since_stop = (
            memory.status.stops,
            0 if memory.forgets_stop else Quote.OLD.sequence,
        )
        service._sequence = Quote.NEW.sequence
        service._executed = deque([sha256(memory.plan)] if memory.begun else [])
        report = EpochReport("reg", 1, REGISTRATION_EPOCH, NOW_S)
        heard = HeardPlan(planned(memory.plan), NOW_S)
        inside = ("wire in distal",) if memory.inside else ()
        service._registration.view = RegistrationView(report, frozenset(), (CASE, 1), inside, (heard,))
        taken = tuple((nonce, NOW_S - PERIOD_S * is_old) for nonce, is_old in memory.used)
        service._permits._used, service._permits.record = UsedPermits(taken), PermitRecord()
        watch._boot_epoch, watch._sequence = memory.heard, 0
        watch._watchdog._last_s = None if memory.heard is None else NOW_S

    def _save(self, before: RobotMemory, payload: bytes | None = None) -> Ran:
        service, motion, watch = self._service, self._drive._motion, self._service.watch
        ledger = service._ledger
        answers = tuple(
            sorted((slot, record.effect, _reply(record.answer)) for slot, record in ledger._records.items())
        )
        newest = tuple(sorted((client, number - FIRST_NUMBER) for client, number in ledger._newest_sequence.items()))
        after = RobotMemory(
            status=plain_status(motion._status),
            pending=motion._pending,
            connected=motion._controller is not None,
            answers=answers,
            newest=newest,
            plan=before.plan,
            begun=bool(service._executed),
            inside=bool(service._registration.view.inside),
            used=tuple(sorted((nonce, at_s < NOW_S) for nonce, at_s in service._permits._used.taken)),
            forgets_stop=before.forgets_stop or (self._plant.stops > 0 and motion._status.stops == 0),
            heard=None if watch._watchdog.expired() else watch._boot_epoch,
        )
        return Ran(
            memory=after,
            plant=self._plant.plant,
            reply=_reply(payload),
            began=tuple(self._plant.began),
            taken=tuple(self._taken),
            stopped=self._plant.stops > 0,
        )


def _bytes(slot: str, reply: Reply | None) -> bytes | None:
    if reply is None:
        return None
    return encode(CommandReply(command_id=slot, verdict=reply.verdict, code=reply.code, state=MotionState.LOCKED))


def _reply(payload: bytes | None) -> Reply | None:
    if payload is None:
        return None
    reply = decode(CommandReply, payload)
    return Reply(reply.verdict, reply.code)


def _crashed(why: str) -> None:
    raise AssertionError(f"the worker failed: {why}")
