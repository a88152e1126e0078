"""The gateway's desks, put together on one bus and one case record; no HTTP and no mathematics."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import EventDraft
from services.ui_api.core.fluoroscopy import RunLimits
from services.ui_api.desks.cases import CaseDesk
from services.ui_api.desks.clock import Clock
from services.ui_api.desks.commands import CommandDesk
from services.ui_api.desks.context import ContextDesk
from services.ui_api.desks.feed import Feed
from services.ui_api.desks.images import ImageDesk
from services.ui_api.desks.inbox import Inbox
from services.ui_api.desks.leases import Leases
from services.ui_api.desks.live import LiveDesk
from services.ui_api.desks.planning import PlanningDesk
from services.ui_api.desks.quality import QualityDesk
from services.ui_api.desks.robot_view import RobotView
from services.ui_api.desks.stop import StopDesk, record_stop
from services.ui_api.desks.verification import VerificationDesk
from services.ui_api.record.database import open_database, sole_gateway
from services.ui_api.record.record import CaseRecord
from services.ui_api.settings import UiApiSettings
from shared.bus.port import Bus
from shared.runtime.lifecycle import Runtime, software_version

LEASE_LAPSED = "the hold-to-move lease lapsed"


@dataclass(frozen=True, slots=True)
class Gateway:
    """Everything the routes may call."""

    record: CaseRecord
    view: RobotView
    stops: StopDesk
    leases: Leases
    commands: CommandDesk
    cases: CaseDesk
    planning: PlanningDesk
    verifications: VerificationDesk
    quality: QualityDesk
    images: ImageDesk
    inbox: Inbox
    feed: Feed
    live: LiveDesk
    clock: Clock
    link_up: Callable[[], bool]


@contextmanager
def open_gateway(bus: Bus, runtime: Runtime, settings: UiApiSettings, clock: Clock) -> Iterator[Gateway]:
    """Open the record, take up where the last run ended, and listen to the bus, for as long as the context lasts.

    Raises
    ------
    ConfigurationError
        When the case record cannot be opened, or another gateway has it open.
    """
    with sole_gateway(settings.record_url()):
        record = CaseRecord(open_database(settings.record_url()), clock.unix_ns)
        gateway, context = _assemble(bus, runtime, settings, clock, record)
        record.append(EventDraft(GatewayStarted(runtime.boot_epoch, software_version()), None, "gateway"))
        gateway.commands.adopt_orphans()
        context.announce()
        gateway.leases.start()
        gateway.inbox.start()
        gateway.live.start()
        try:
            yield gateway
        finally:
            gateway.feed.close()
            gateway.live.close()
            gateway.leases.close()
            gateway.commands.close()
            gateway.inbox.close()
            record.close()


def _assemble(
    bus: Bus, runtime: Runtime, settings: UiApiSettings, clock: Clock, record: CaseRecord
) -> tuple[Gateway, ContextDesk]:
    keys = runtime.keys
    view = RobotView(clock, settings.robot_state_stale_after_s)
    stops = StopDesk(bus, keys, f"gateway-{runtime.boot_epoch[:12]}")
    leases = Leases(clock, settings.lease_s, lambda _: _stop_for_lapse(record, stops))
    commands = CommandDesk(bus, keys, record, view, stops, leases, clock)
    context = ContextDesk(bus, keys, record)
    limits = RunLimits(settings.run_interval_s, settings.run_calibrations)
    feed = Feed()
    record.listen(lambda _: feed.wake())
    gateway = Gateway(
        record=record,
        view=view,
        stops=stops,
        leases=leases,
        commands=commands,
        cases=CaseDesk(record, context.announce),
        planning=PlanningDesk(bus, keys, record, view, commands),
        verifications=VerificationDesk(bus, keys, record),
        quality=QualityDesk(bus, keys, record),
        images=ImageDesk(bus, keys, record, settings.images()),
        inbox=Inbox(bus, keys, record, view, commands, runtime.log, limits),
        feed=feed,
        live=LiveDesk(bus, keys, clock),
        clock=clock,
        link_up=bus.presence().link_up,
    )
    return gateway, context


def _stop_for_lapse(record: CaseRecord, stops: StopDesk) -> None:
    record_stop(record, stops.stop(LEASE_LAPSED), LEASE_LAPSED, "gateway")
