"""The gateway's handlers, assembled on one bus and one case record; no HTTP and no mathematics."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from services.ui_api.access.access_control import AccessControl
from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.handlers.acting import Acting
from services.ui_api.handlers.bus_refusals import BusRefusalLog
from services.ui_api.handlers.cases import CaseHandler
from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.commands import CommandHandler
from services.ui_api.handlers.computations import ComputationHandler
from services.ui_api.handlers.context import ContextHandler
from services.ui_api.handlers.diagnosis import Diagnosis
from services.ui_api.handlers.disk_space import DiskSpace
from services.ui_api.handlers.event_tail import EventTail
from services.ui_api.handlers.feed import Feed
from services.ui_api.handlers.images import ImageHandler
from services.ui_api.handlers.inbox import WATCHED_SERVICES, Inbox
from services.ui_api.handlers.leases import Leases
from services.ui_api.handlers.live import LiveHandler
from services.ui_api.handlers.operation_progress import OperationProgress
from services.ui_api.handlers.permits import PermitHandler
from services.ui_api.handlers.picture_encoder import PictureEncoder
from services.ui_api.handlers.planning import PlanningHandler
from services.ui_api.handlers.procedure import ProcedureHandler
from services.ui_api.handlers.quality import QualityHandler
from services.ui_api.handlers.readiness import Readiness, ReadinessParts
from services.ui_api.handlers.robot_view import RobotView
from services.ui_api.handlers.service_health import ServiceHealth
from services.ui_api.handlers.stop import StopHandler
from services.ui_api.handlers.stop_recorder import StopRecorder
from services.ui_api.handlers.stop_sender import StopSender
from services.ui_api.handlers.verification import VerificationHandler
from services.ui_api.record.database import open_database, sole_gateway
from services.ui_api.record.record import CaseRecord
from services.ui_api.settings import UiApiSettings
from shared.bus.port import Bus
from shared.pki.permit_key import PermitSigner
from shared.runtime.lifecycle import Runtime, software_version
from shared.runtime.presence import StatusReporter

# Chosen: half a minute of fluoroscopy of each case in memory, which an hour of it must not fill.
_IMAGES_HELD: Final = 1024
LEASE_LAPSED = "the hold-to-move lease lapsed"


@dataclass(frozen=True, slots=True)
class Gateway:
    """Everything the routes may call."""

    record: CaseRecord
    view: RobotView
    stops: StopHandler
    stop_sender: StopSender
    stop_recorder: StopRecorder
    leases: Leases
    commands: CommandHandler
    procedure: ProcedureHandler
    cases: CaseHandler
    planning: PlanningHandler
    verifications: VerificationHandler
    quality: QualityHandler
    computations: ComputationHandler
    progress: OperationProgress
    images: ImageHandler
    inbox: Inbox
    feed: Feed
    tail: EventTail
    live: LiveHandler
    clock: Clock
    link_up: Callable[[], bool]
    services: ServiceHealth
    refusals: BusRefusalLog
    readiness: Readiness
    diagnosis: Diagnosis
    status: StatusReporter
    access: AccessControl
    acting: Acting


@contextmanager
def open_gateway(bus: Bus, runtime: Runtime, settings: UiApiSettings, clock: Clock) -> Iterator[Gateway]:
    """Open the record, take up where the last run ended, and listen to the bus, for as long as the context lasts.

    Raises
    ------
    ConfigurationError
        When the case record cannot be opened, or another gateway has it open, or the permit key is missing.
    """
    with sole_gateway(settings.record_url()):
        signer = settings.permit_signer()
        record = CaseRecord(open_database(settings.record_url()), clock.unix_ns, _IMAGES_HELD)
        gateway, context = _assemble(bus, runtime, settings, clock, record, signer)
        record.append(EventDraft(GatewayStarted(runtime.boot_epoch, software_version()), None, "gateway"))
        gateway.access.start()
        gateway.commands.adopt_orphans()
        gateway.computations.adopt_orphans()
        context.announce()
        gateway.stop_recorder.start()
        gateway.leases.start()
        gateway.inbox.start()
        gateway.live.start()
        gateway.services.start()
        try:
            yield gateway
        finally:
            gateway.readiness.close()
            gateway.computations.close()
            gateway.feed.close()
            gateway.live.close()
            gateway.leases.close()
            gateway.commands.close()
            gateway.inbox.close()
            gateway.stop_recorder.close()
            record.close()


def _assemble(
    bus: Bus, runtime: Runtime, settings: UiApiSettings, clock: Clock, record: CaseRecord, signer: PermitSigner
) -> tuple[Gateway, ContextHandler]:
    keys = runtime.keys
    view = RobotView(clock, settings.robot_state_stale_after_s)
    stops = StopHandler(bus, keys, f"gateway-{runtime.boot_epoch[:12]}")
    recorder = StopRecorder(record)
    leases = Leases(clock, settings.lease_s, lambda _: _stop_for_lapse(stops, recorder))
    permits, acting = PermitHandler(record, signer), Acting()
    commands = CommandHandler(bus, keys, record, view, stops, leases, clock, permits, acting)
    context = ContextHandler(bus, keys, record)
    tail, feed = _followed(record)
    refusals = BusRefusalLog(clock)
    inbox = Inbox(bus, keys, record, view, commands, refusals, runtime.log, settings.run_calibrations)
    services = ServiceHealth(bus, keys, clock, WATCHED_SERVICES)
    disk = DiskSpace(settings, settings.images(), services)
    link_up = bus.presence().link_up
    live = LiveHandler(bus, keys, clock, PictureEncoder(), acting)
    asked = ReadinessParts(
        record, view, inbox, services, refusals, runtime.status, link_up, settings, clock, live.paths
    )
    procedure, readiness = ProcedureHandler(record, view), Readiness(asked)
    gateway = Gateway(
        record=record,
        view=view,
        stops=stops,
        stop_sender=StopSender(stops.stop),
        stop_recorder=recorder,
        leases=leases,
        commands=commands,
        procedure=procedure,
        cases=CaseHandler(record, context.announce, disk.lack, settings.part_is_approved, procedure),
        planning=PlanningHandler(bus, keys, record, procedure, commands),
        verifications=VerificationHandler(bus, keys, record, procedure),
        quality=QualityHandler(bus, keys, record),
        computations=ComputationHandler(record),
        progress=OperationProgress(record, view),
        images=ImageHandler(bus, keys, record, settings.images()),
        inbox=inbox,
        feed=feed,
        tail=tail,
        live=live,
        clock=clock,
        link_up=link_up,
        services=services,
        refusals=refusals,
        readiness=readiness,
        diagnosis=Diagnosis(settings, readiness),
        status=runtime.status,
        access=AccessControl(record, clock, settings.access(), feed.wake),
        acting=acting,
    )
    return gateway, context


def _followed(record: CaseRecord) -> tuple[EventTail, Feed]:
    """The newest events, and who wakes the streams that read them: in this order after each entry."""
    tail, feed = EventTail(record.ledger.head_sequence), Feed()
    record.listen(tail.take)
    record.listen(lambda _: feed.wake())
    return tail, feed


def _stop_for_lapse(stops: StopHandler, recorder: StopRecorder) -> None:
    recorder.put(stops.stop(LEASE_LAPSED), LEASE_LAPSED, "gateway")
